"""Commands for the background services: `up`, `status`, `down`, `ui`."""

import sys
from pathlib import Path

import click

from cluster.cli.parameters import WholeNumber
from cluster.cli.places import home_option

_port = WholeNumber(1, 65535)
_host_option = click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to bind to."
)


@click.command()
@home_option
@_host_option
@click.option(
    "--ray-port", type=_port, default=6379, show_default=True, help="Port of the Ray head."
)
@click.option(
    "--dashboard-port",
    type=_port,
    default=8265,
    show_default=True,
    help="Port of Ray's dashboard.",
)
@click.option(
    "--mlflow-port", type=_port, default=5000, show_default=True, help="Port of the MLflow server."
)
def up(home: Path, host: str, ray_port: int, dashboard_port: int, mlflow_port: int) -> None:
    """Start a Ray head and an MLflow server in the background, for studies to join."""
    from cluster.services import background
    from cluster.storage.home import Home

    background.up(Home(home), host, ray_port, dashboard_port, mlflow_port, click.echo)


@click.command()
@home_option
def status(home: Path) -> None:
    """Print the state of the services; exit code 0 if all are up, else 1."""
    from cluster.services.background import services
    from cluster.services.mlflow_server import pages
    from cluster.storage.home import Home

    found = services(Home(home))
    for service in found:
        click.echo(f"{service.name:8}{service.state:15}{service.page}  log {service.log}")
        if service.name == "mlflow" and service.state == "up":
            for page in pages(Home(home), service.address):
                click.echo(f"{'':8}{page}")
    if not found:
        click.echo(f"nothing is up in {str(home)!r}: start with {Home(home).hint('up', 'up')}")
    sys.exit(0 if found and all(service.state == "up" for service in found) else 1)


@click.command()
@home_option
def down(home: Path) -> None:
    """Stop the services that `up` started in this home."""
    from cluster.services import background
    from cluster.storage.home import Home

    background.down(Home(home), click.echo)


@click.command()
@home_option
@_host_option
@click.option("--port", type=_port, default=5000, show_default=True, help="Port of the UI.")
def ui(home: Path, host: str, port: int) -> None:
    """Serve the MLflow UI on the runs of the home folder until Ctrl-C."""
    from cluster.services.background import join
    from cluster.services.mlflow_server import addresses, serve_ui
    from cluster.storage.home import Home

    running = join("mlflow", Home(home))
    if running is not None:
        for line in addresses(Home(home), running):
            click.echo(line)
        return
    sys.exit(serve_ui(Home(home), host, port))
