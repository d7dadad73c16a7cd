"""SEs on the command line: where their files are, and what they are called."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bilevel.errors import InvalidInput
from cluster.cli.places import home_option, the_tracking_uri, tracking_option
from cluster.storage.home import DEFAULT_HOME, Home

if TYPE_CHECKING:
    from bilevel.synthetic_env import StoredSE

task_option = click.option(
    "--task",
    "se_task",
    metavar="MODULE:ID",
    help="The SE's task, as it was learned for, if a module of yours registers it: the module is "
    "imported.",
)


def mlflow_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """`--home` and `--tracking-uri` of a command that uses them for the address of an SE alone."""

    @functools.wraps(function)
    def without_them(*, home: Path, tracking_uri: str | None, **values: Any) -> Any:
        return function(**values)

    return home_option(tracking_option(without_them))


@dataclass(frozen=True)
class GivenSE:
    """The file of an SE that the command line names."""

    path: Path
    label: str  # what it is called in tables, names and pictures

    @classmethod
    def of(cls, path: Path) -> "GivenSE":
        """That of a path."""
        return cls(path, label_of(path))


class SEAddress(click.ParamType[GivenSE]):
    """A file of an SE, given as its path, as a name of the zoo, or as MLflow's address."""

    name = "SE"

    def convert(
        self, value: Any, param: click.Parameter | None, context: click.Context | None
    ) -> GivenSE:
        """The file. Raises InvalidInput if there is none, and if MLflow, which `--home` and
        `--tracking-uri` of the same command tell, cannot be reached or has none at an address."""
        from bilevel.synthetic_env.source import is_of_mlflow, pinned, se_file
        from bilevel.zoo import ENTRIES, label, zoo_file

        if value in ENTRIES:
            return GivenSE(zoo_file(value), label(value))
        if not is_of_mlflow(value):
            return GivenSE.of(se_file(value))
        from cluster.tracking.connection import check_tracking_uri, connected

        given = {} if context is None else context.params
        home = Home(given.get("home") or DEFAULT_HOME)
        uri = the_tracking_uri(given.get("tracking_uri"), home)
        if uri == home.database_uri and not home.database.exists():
            raise InvalidInput(f"MLflow has no SE at {value!r}: no runs in {str(home.folder)!r}")
        check_tracking_uri(uri)
        with connected(uri):  # errors of the database are told
            address = pinned(value, uri)
            return GivenSE(se_file(address, uri), _label_at(address))


def label_of(path: Path) -> str:
    """What an SE is called by its file: the name of the file or, if every run has one of that name,
    of the run's folder."""
    from cluster.storage.run_folder import SETTINGS_FILE, USUAL_FILES

    folder = path.resolve().parent
    usual = path.name in USUAL_FILES and (folder / SETTINGS_FILE).exists()
    return folder.name if usual else path.stem


def _label_at(address: str) -> str:
    """What an SE is called by MLflow's address: `NAME-VERSION` for models:/NAME/VERSION, and else
    the file's name or, if every run has one of that name, the run's ID."""
    from cluster.storage.run_folder import USUAL_FILES

    kind, _, place = address.partition(":/")
    if kind == "models":
        return place.replace("/", "-")
    *folders, file = (part for part in Path(place).parts if part != "artifacts")
    return folders[-1] if folders and file in USUAL_FILES else Path(file).stem


def load_se_of(path: Path, task: str | None) -> "StoredSE":
    """The SE in a file; `task`, if given, is the id of its task, whose module is imported. Raises
    InvalidInput for another task."""
    from bilevel.synthetic_env import load_se
    from bilevel.tasks import get_task

    stored = load_se(path)
    if task is not None:
        if task != stored.task_id:
            raise InvalidInput(f"--task {task}: {str(path)!r} is an SE for {stored.task_id}")
        get_task(task, stored.solved_reward, stored.step_limit)
    return stored
