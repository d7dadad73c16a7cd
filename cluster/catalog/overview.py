"""`bilevel runs`: all runs in a home with their state, progress and best score."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bilevel.errors import InvalidInput, OtherVersion
from cluster.catalog.kinds import KINDS, kind_of
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, finals, is_held

_STATES = {"FINISHED": "finished", "KILLED": "stopped", "FAILED": "failed", "RUNNING": "killed"}


#: Columns of output that is not a terminal: more than any line needs.
_PIPED = 1000


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
    fault: str = ""  # what is wrong with a run that cannot be read


def overview(home: Home) -> list[Line]:
    """All runs in a home, of every kind, by task and name."""
    return [_line(folder) for folder in home.runs()]


def print_overview(lines: list[Line], console: Console) -> None:
    """As a table, and what is wrong with runs that cannot be read; names are folded where the table
    is too wide for a terminal."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for column in ("task", "name", "kind", "state", "progress"):
        table.add_column(column, no_wrap=column not in ("name", "progress"), overflow="fold")
    table.add_column("best", justify="right", no_wrap=True)
    table.add_column("final", justify="right", no_wrap=True)
    for line in lines:
        cells = (line.task, line.name, line.kind, line.state, line.progress, line.best, line.final)
        table.add_row(*cells)
    if not console.is_terminal:
        console.width = _PIPED
    console.print(table)
    faults = [f"{line.task}/{line.name}: {line.fault}" for line in lines if line.fault]
    if faults:
        console.print("\n".join(("", *faults)), highlight=False, markup=False, emoji=False)
    if any(line.state == "damaged" for line in lines):
        console.print(
            "A run with a damaged state.safetensors needs no more than its command again, which "
            "repeats its generations. Bring other damaged files back from a copy, or move the "
            "run's folder away and begin anew.",
            highlight=False,
        )


def _line(folder: Path) -> Line:
    task, name = folder.parent.name, folder.name
    try:
        kind = kind_of(folder)
        run_status = RunStatus.load(folder)
        state = (
            "running" if is_held(folder) else _STATES[run_status.status if run_status else "KILLED"]
        )
        target = 0 if run_status is None else run_status.target
        progress = KINDS[kind].progress(folder, target)
        scores = [end.metrics.get("final_score_mean") for end in finals(folder)]
        final = f"{scores[-1]:.1f}" if scores and scores[-1] is not None else ""
    except OtherVersion as error:
        return Line(task, name, "", "old", fault=str(error))
    except (InvalidInput, OSError) as error:
        return Line(task, name, "", "damaged", fault=str(error))
    return Line(task, name, kind, state, progress.done, progress.best, final)
