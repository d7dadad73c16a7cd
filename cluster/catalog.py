"""The kinds of runs, `bilevel runs` and `bilevel sync`."""

from dataclasses import astuple, dataclass
from pathlib import Path

from rich.console import Console

from bilevel.errors import InvalidInput, OtherVersion, unknown_value
from cluster.bohb.view import StudyViews
from cluster.evaluate.run import EvaluationViews
from cluster.experiments.run import ExperimentViews
from cluster.nes.view import NESViews
from cluster.session.terminal import Terminal, count
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, finals, held, is_held, read_settings
from cluster.tracking import Tracker, Views
from cluster.tracking.connection import mlflow_errors

#: Views of all kinds of runs, by the kind's name in a run's settings.
KINDS: dict[str, type[Views]] = {
    views.kind: views for views in (StudyViews, NESViews, EvaluationViews, ExperimentViews)
}

_STATES = {"FINISHED": "finished", "KILLED": "stopped", "FAILED": "failed", "RUNNING": "killed"}


def views_of(folder: Path) -> Views:
    """Views of a folder that no process works on. Raises InvalidInput for a damaged folder."""
    kind = str(read_settings(folder).get("kind"))
    if kind not in KINDS:
        raise unknown_value("kind of run", kind, KINDS)
    return KINDS[kind](folder)


@dataclass(frozen=True)
class Line:
    """A run of any kind in one line."""

    task: str
    name: str
    kind: str
    state: str  # running, finished, stopped, killed, failed, damaged; old: of another format
    progress: str = ""
    best: str = ""  # incumbent's core seconds per SE (study), or best score (NES run) so far
    final: str = ""  # mean score of fresh agents on the best SE
    fault: str = ""  # error message of a run that cannot be read


def overview(home: Home) -> list[Line]:
    """All runs in a home by task and name."""
    return [_line(folder) for folder in home.runs()]


def print_overview(lines: list[Line], console: Console) -> None:
    """Print a table, and the errors of runs that cannot be read."""
    head = ("task", "name", "kind", "state", "progress", "best", "final")
    rows = [head, *(astuple(line)[:-1] for line in lines)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    texts = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    texts += [f"{line.task}/{line.name}: {line.fault}" for line in lines if line.fault]
    console.print("\n".join(texts), highlight=False, markup=False, emoji=False, soft_wrap=True)


def _line(folder: Path) -> Line:
    task, name = folder.parent.name, folder.name
    try:
        views, status = views_of(folder), RunStatus.load(folder)
        state = _STATES["KILLED" if status is None else status.status]
        state = "running" if is_held(folder) else state
        (progress, best), ends = views.progress(), finals(folder)
        score = ends[-1].metrics.get("final_score_mean") if ends else None
    except OtherVersion as error:
        return Line(task, name, "", "old", fault=str(error))
    except (InvalidInput, OSError) as error:
        return Line(task, name, "", "damaged", fault=str(error))
    final = "" if score is None else f"{score:.1f}"
    return Line(task, name, views.kind, state, progress, best, final)


def sync(folder: Path, home: Home, tracking_uri: str, terminal: Terminal) -> None:
    """Write the parts of a run that MLflow lacks, from the run's files alone.

    The call may be repeated. Raises InvalidInput if the folder is damaged or in use by another
    process, or if MLflow fails or rejects a run.
    """
    with held(folder):
        views = views_of(folder)
        keys = views.keys()
        tracker = Tracker(tracking_uri, views.task_id, home)
        with terminal, mlflow_errors(tracking_uri):
            for done, key in enumerate(keys):
                terminal.bar("sync", done, len(keys), "runs")
                tracker.show(views.view(key))
        terminal.log(f"{folder.name}: {count(len(keys), 'run')} in MLflow now match the disk")
        terminal.log(f"MLflow {tracker.address(keys[0])}")
