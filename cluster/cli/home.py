"""Commands on the runs of a home: `runs`, `sync` and `ui`."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import click

from bilevel.errors import InvalidInput
from cluster.cli.options import agent_file_option, home_option, tracking_option
from cluster.storage.home import Home


@click.command()
@home_option
def runs(home: Path) -> None:
    """List all studies and other runs: state, progress, best score."""
    from cluster.catalog import overview, print_overview
    from cluster.session.terminal import Terminal

    lines = overview(Home(home))
    if lines:
        print_overview(lines, Terminal().console)
    else:
        click.echo(_no_runs(Home(home)))


def _no_runs(home: Home) -> str:
    start = home.hint("nes CartPole-v0")
    return f"no runs in {str(home.folder)!r} yet: start with {start}"


@click.command()
@click.argument("run")
@home_option
@tracking_option
@agent_file_option
def sync(run: str, home: Path, tracking_uri: str | None, agent_files: tuple[Path, ...]) -> None:
    """Write the missing parts of RUN to MLflow, from the files on disk.

    RUN is the name of a study or another run, or TASK/NAME if several tasks have a run of that
    name.
    """
    from bilevel.agents import load_plugins
    from cluster.catalog import sync as write
    from cluster.ray.agent_files import load_agent_file
    from cluster.session.terminal import Terminal

    load_plugins()
    for file in agent_files:
        load_agent_file(file)
    place = Home(home)
    write(place.find(run), place, tracking_uri or place.database_uri, Terminal())


@click.command()
@home_option
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to bind to.")
@click.option(
    "--port", type=click.IntRange(1, 65535), default=5000, show_default=True, help="Port of the UI."
)
def ui(home: Path, host: str, port: int) -> None:
    """Serve the MLflow UI on the runs of the home folder until Ctrl-C."""
    from cluster.session.interrupts import InterruptGuard
    from cluster.session.terminal import Terminal
    from cluster.tracking.connection import connected
    from cluster.tracking.tracker import HOME_PAGE, runs_page

    place = Home(home)
    if not place.database.exists():
        raise InvalidInput(_no_runs(place))
    with connected(place.database_uri) as client:
        tasks = client.search_experiments(order_by=["experiment_id ASC"])
    try:
        socket.create_server((host, port)).close()
    except OSError as error:
        raise InvalidInput(f"cannot serve on {host}:{port}: {error.strerror}") from None
    server = f"http://{host}:{port}"
    click.echo(f"MLflow UI: {server}{HOME_PAGE} (Ctrl-C stops it)")
    for task in tasks:
        click.echo(f"{task.name}: {server}{runs_page(task.experiment_id)}")
    # Clients write artifacts directly, so that the database can be used without the server.
    command = [
        *(sys.executable, "-m", "mlflow", "server", "--host", host, "--port", str(port)),
        *("--workers", "1", "--uvicorn-opts", "--log-level error"),
        *("--backend-store-uri", place.database_uri, "--registry-store-uri", place.database_uri),
        *("--default-artifact-root", place.artifacts.as_uri()),
    ]
    # Log only errors, and run no jobs for language models.
    environment = {
        **os.environ,
        "MLFLOW_LOGGING_LEVEL": "ERROR",
        "PYTHONWARNINGS": "ignore",
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
    }
    # In its own session, because MLflow prints tracebacks after Ctrl-C, but not after SIGTERM.
    with (
        InterruptGuard(Terminal()),
        subprocess.Popen(command, env=environment, start_new_session=True) as process,
    ):
        try:
            sys.exit(process.wait())
        except KeyboardInterrupt:
            os.killpg(process.pid, signal.SIGTERM)
