"""SEs on the command line: their files and labels."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bilevel.errors import InvalidInput
from cluster.cli.decorators import home_option, tracking_option
from cluster.storage.home import DEFAULT_HOME, Home

if TYPE_CHECKING:
    from bilevel.synthetic_env import StoredSE

task_option = click.option(
    "--task",
    "se_task",
    metavar="MODULE:ID",
    help="Task of the SE, as given to `nes`, if a custom module registers it; the module is "
    "imported.",
)


def mlflow_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add `--home` and `--tracking-uri` to a command that uses them only for an SE's address."""

    @functools.wraps(function)
    def without_options(*, home: Path, tracking_uri: str | None, **values: Any) -> Any:
        return function(**values)

    return home_option(tracking_option(without_options))


@dataclass(frozen=True)
class GivenSE:
    """The file of an SE that the command line names."""

    path: Path
    label: str  # in tables, names and pictures

    @classmethod
    def of(cls, path: Path) -> "GivenSE":
        """Label a file by its name, or by its run if every run has a file of that name."""
        from cluster.storage.run_folder import SETTINGS_FILE, USUAL_FILES

        folder = path.resolve().parent
        in_run = path.name in USUAL_FILES and (folder / SETTINGS_FILE).exists()
        return cls(path, folder.name if in_run else path.stem)


class SEAddress(click.ParamType[GivenSE]):
    """The file of an SE, given as a path, a name in the zoo, or an address in MLflow."""

    name = "SE"

    def convert(
        self, value: Any, param: click.Parameter | None, context: click.Context | None
    ) -> GivenSE:
        """Return the file. MLflow is given by `--home` and `--tracking-uri` of the same command.

        Raises InvalidInput if there is no SE at the address, or MLflow is not reachable.
        """
        from bilevel.synthetic_env.source import is_mlflow_address, pinned, se_file
        from bilevel.zoo import ENTRIES, zoo_file

        if value in ENTRIES:
            return GivenSE(zoo_file(value), f"Synthetic-{value}")
        if not is_mlflow_address(value):
            return GivenSE.of(se_file(value))
        from cluster.tracking.connection import connected

        options = {} if context is None else context.params
        home = Home(options.get("home") or DEFAULT_HOME)
        given = options.get("tracking_uri")  # a placeholder of click's if it is not given
        uri = given if isinstance(given, str) else home.database_uri
        if uri == home.database_uri and not home.database.exists():
            raise InvalidInput(f"MLflow has no SE at {value!r}: no runs in {str(home.folder)!r}")
        with connected(uri):
            address = pinned(value, uri)
            return GivenSE(se_file(address, uri), _label_at(address))


def _label_at(address: str) -> str:
    """Label an address in MLflow: `NAME-VERSION` for models:/NAME/VERSION, else the file's name or,
    if every run has a file of that name, the run's ID."""
    from cluster.storage.run_folder import USUAL_FILES

    kind, _, place = address.partition(":/")
    if kind == "models":
        return place.replace("/", "-")
    *folders, file = (part for part in Path(place).parts if part != "artifacts")
    return folders[-1] if folders and file in USUAL_FILES else Path(file).stem


def load_se_of(path: Path, task: str | None) -> "StoredSE":
    """Load an SE and, if its task's id is given, import the task's module. Raises InvalidInput for
    another task."""
    from bilevel.synthetic_env import load_se
    from bilevel.tasks import get_task

    stored = load_se(path)
    if task is not None:
        if task != stored.task_id:
            raise InvalidInput(f"--task {task}: {str(path)!r} is an SE for {stored.task_id}")
        get_task(task, stored.solved_reward, stored.step_limit)
    return stored
