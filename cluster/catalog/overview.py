"""`bilevel runs`: all runs in a home with their state, progress and best score."""

from dataclasses import astuple, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bilevel.errors import InvalidInput, OtherVersion
from cluster.catalog.kinds import KINDS, kind_of
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, finals, is_held

_STATES = {"FINISHED": "finished", "KILLED": "stopped", "FAILED": "failed", "RUNNING": "killed"}
_PIPED_WIDTH = 1000  # columns of output that is not a terminal: more than any line needs


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
    """Print a table, and the errors of runs that cannot be read. Names are folded if the table is
    too wide for a terminal."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("task", "name", "kind", "state", "progress"):
        table.add_column(column, no_wrap=column not in ("name", "progress"), overflow="fold")
    for column in ("best", "final"):
        table.add_column(column, justify="right", no_wrap=True)
    for line in lines:
        table.add_row(*astuple(line)[:-1])
    if not console.is_terminal:
        console.width = _PIPED_WIDTH
    console.print(table)
    faults = [f"{line.task}/{line.name}: {line.fault}" for line in lines if line.fault]
    if faults:
        console.print("\n".join(("", *faults)), highlight=False, markup=False, emoji=False)
    if any(line.state == "damaged" for line in lines):
        console.print(
            "Run the same command again to repair a run with a damaged state.safetensors; it "
            "repeats the generations. Restore other damaged files from a backup, or move the run's "
            "folder away and start again.",
            highlight=False,
        )


def _line(folder: Path) -> Line:
    task, name = folder.parent.name, folder.name
    try:
        kind = kind_of(folder)
        status = RunStatus.load(folder) or RunStatus("KILLED", 0.0, 0)
        state = "running" if is_held(folder) else _STATES[status.status]
        progress = KINDS[kind].progress(folder, status.target)
        ends = finals(folder)
        score = ends[-1].metrics.get("final_score_mean") if ends else None
    except OtherVersion as error:
        return Line(task, name, "", "old", fault=str(error))
    except (InvalidInput, OSError) as error:
        return Line(task, name, "", "damaged", fault=str(error))
    final = "" if score is None else f"{score:.1f}"
    return Line(task, name, kind, state, progress.done, progress.best, final)
