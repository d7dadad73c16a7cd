"""The command `ui`."""

import os
import socket
import sys
from pathlib import Path

import click

from bilevel.errors import InvalidInput
from cluster.cli.decorators import home_option
from cluster.storage.home import Home


@click.command()
@home_option
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to bind to.")
@click.option(
    "--port", type=click.IntRange(1, 65535), default=5000, show_default=True, help="Port of the UI."
)
def ui(home: Path, host: str, port: int) -> None:
    """Serve the MLflow UI on the runs of the home folder until Ctrl-C."""
    from cluster.tracking.connection import connected
    from cluster.tracking.tracker import HOME_PAGE, runs_page

    place = Home(home)
    if not place.database.exists():
        start = place.hint("nes CartPole-v0", "nes-cartpole")
        raise InvalidInput(f"no runs in {str(place.folder)!r} yet: start with {start}")
    with connected(place.database_uri) as client:
        tasks = client.search_experiments(order_by=["experiment_id ASC"])
    _require_free(host, port)
    server = f"http://{'127.0.0.1' if host == '0.0.0.0' else host}:{port}"
    click.echo(f"MLflow UI: {server}{HOME_PAGE} (Ctrl-C stops it)")
    for task in tasks:
        click.echo(f"{task.name}: {server}{runs_page(task.experiment_id)}")
    sys.stdout.flush()
    command, environment = mlflow_server(place, host, port)
    os.execvpe(command[0], command, {**os.environ, **environment})


def mlflow_server(home: Home, host: str, port: int) -> tuple[list[str], dict[str, str]]:
    """Return the command of an MLflow server on a home, and its environment variables.

    Clients of the server write artifacts to the locations in the database, so that the database can
    be used with and without the server.
    """
    command = [sys.executable, "-m", "mlflow", "server", "--host", host, "--port", str(port)]
    command += ["--workers", "1", "--uvicorn-opts", "--log-level error"]
    command += ["--backend-store-uri", home.database_uri]
    command += ["--registry-store-uri", home.database_uri]
    command += ["--default-artifact-root", home.artifacts.as_uri()]
    # Log only errors, and run no jobs for language models.
    return command, {
        "MLFLOW_LOGGING_LEVEL": "ERROR",
        "PYTHONWARNINGS": "ignore",
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
    }


def _require_free(host: str, port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InvalidInput(f"cannot serve on {host}:{port}: {error.strerror}") from None
