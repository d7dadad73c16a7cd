"""Commands for what runs beside the runs: `ui`."""

import sys
from pathlib import Path

import click

from cluster.cli.options import home_option


@click.command()
@home_option
@click.option("--host", default="127.0.0.1", show_default=True)
@click.option("--port", type=click.IntRange(1, 65535), default=5000, show_default=True)
def ui(home: Path, host: str, port: int) -> None:
    """The MLflow UI on the runs of the home folder, until Ctrl-C."""
    from cluster.home import Home
    from cluster.ui import serve_ui

    sys.exit(serve_ui(Home(home), host, port))
