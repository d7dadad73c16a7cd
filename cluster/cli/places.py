"""Where a command works: the options of home, MLflow and Ray cluster, and what they come to."""

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bilevel.errors import InvalidInput
from cluster.cli.parameters import Folder
from cluster.storage.home import DEFAULT_HOME, Home

if TYPE_CHECKING:
    from cluster.session.context import RunContext

home_option = click.option(
    "--home",
    type=Folder(),
    default=DEFAULT_HOME,
    show_default=True,
    is_eager=True,  # as --tracking-uri: the address of an SE is read by them
    help="Folder of checkpoints, journals and MLflow's database.",
)

tracking_option = click.option(
    "--tracking-uri",
    is_eager=True,
    help="URI of an MLflow server or database (default: $MLFLOW_TRACKING_URI, else the server of "
    "`up`, else a SQLite database in --home).",
)


address_option = click.option(
    "--address",
    help="Ray cluster to join, of which this machine is a node: host:port, auto, or local for a "
    "new one (default: $RAY_ADDRESS, else the head of `up`, else local).",
)


def the_tracking_uri(given: str | None, home: Home) -> str:
    """The tracking URI: the option, MLFLOW_TRACKING_URI, the home's server, or its database."""
    from cluster.services.background import join

    named = given or os.environ.get("MLFLOW_TRACKING_URI")
    return named or join("mlflow", home) or home.database_uri


def the_address(given: str | None, home: Home) -> str | None:
    """Address of the Ray cluster to join: the option, RAY_ADDRESS, or the home's head, whose token
    is then used, also if it is named by its address, or as `auto`.

    None starts a local cluster.
    """
    from cluster.services.background import join, services

    named = given if given not in (None, "auto") else os.environ.get("RAY_ADDRESS") or given
    if named == "local":
        return None
    if named is None:
        return join("ray", home)
    with suppress(InvalidInput):  # of a head that does not answer, which another may replace
        heads = [service.address for service in services(home) if service.name == "ray"]
        if named in ("auto", *heads):
            return join("ray", home) or named
    return named


def the_context(home: Path, tracking_uri: str | None, address: str | None) -> "RunContext":
    """Home, MLflow and Ray cluster: those of the options, or the services of `up`.

    Must be called before any import of Ray, which reads the environment set here.
    """
    in_home = Home(home)
    uri, cluster = the_tracking_uri(tracking_uri, in_home), the_address(address, in_home)

    from cluster.session.context import RunContext

    given = bool(tracking_uri or os.environ.get("MLFLOW_TRACKING_URI"))
    return RunContext(in_home, uri, cluster, given)
