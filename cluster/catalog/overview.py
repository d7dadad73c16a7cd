"""`bilevel studies`: what lies in a home, how it stands, how good it is."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters import SEHyperparameters
from bilevel.nes import NESState
from cluster.bohb.journal import Journal
from cluster.bohb.profiles import ENDLESS
from cluster.bohb.study import KIND as STUDY_KIND
from cluster.bohb.study import Study
from cluster.bohb.summary import StudySummary
from cluster.evaluate.view import KIND as EVALUATION_KIND
from cluster.evaluate.view import RESULTS_FILE, EvaluationSettings
from cluster.nes.run import KIND as NES_KIND
from cluster.nes.run import STATE_FILE, NESSettings
from cluster.storage.home import Home
from cluster.storage.lines import Lines
from cluster.storage.run_folder import Standing, finals, is_held, read_settings

_STATES = {"FINISHED": "finished", "KILLED": "stopped", "FAILED": "failed", "RUNNING": "killed"}


#: Columns of output that is not a terminal: more than any line needs.
_PIPED = 1000


@dataclass(frozen=True)
class Line:
    """A study or NES run in one line."""

    task: str
    name: str
    kind: str
    state: str  # running, finished, stopped, killed, failed, damaged
    progress: str
    best: str  # best objective (study) or score (NES run) so far
    final: str  # mean score of fresh agents on the best SE


def overview(home: Home) -> list[Line]:
    """All studies and NES runs in a home, by task and name."""
    return [_line(folder) for folder in home.runs()]


def print_overview(lines: list[Line], console: Console) -> None:
    """As a table; where it is too wide for a terminal, names are folded."""
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


def _line(folder: Path) -> Line:
    task, name = folder.parent.name, folder.name
    try:
        kind = str(read_settings(folder).get("kind"))
        kinds = {STUDY_KIND: _study, NES_KIND: _nes, EVALUATION_KIND: _evaluation}
        if kind not in kinds:
            raise one_of("kind of run", kind, kinds)
        standing = Standing.load(folder)
        state = "running" if is_held(folder) else _STATES[standing.status if standing else "KILLED"]
        target = 0 if standing is None else standing.target
        progress, best = kinds[kind](folder, target)
        scores = [end.metrics.get("final_score_mean") for end in finals(folder)]
        final = f"{scores[-1]:.1f}" if scores and scores[-1] is not None else ""
    except (InvalidInput, OSError) as error:
        return Line(task, name, "", "damaged", str(error), "", "")
    return Line(task, name, kind, state, progress, best, final)


def _study(folder: Path, brackets: int) -> tuple[str, str]:
    journal = Journal(folder)
    rungs = Study.read(folder).schedule.brackets(brackets)
    incumbent = StudySummary(journal, rungs).incumbent
    best = "" if incumbent is None else f"{incumbent.objective:.1f}"
    results = len(journal.results)
    total = max(sum(rung.configurations for rung in rungs), results)
    return f"{results} results" if brackets >= ENDLESS else f"{results}/{total} results", best


def _nes(folder: Path, generations: int) -> tuple[str, str]:
    path = folder / STATE_FILE
    if not path.exists():
        return f"0/{generations} generations", ""
    # The agents of the run, which may be a user's own, need not be known here.
    settings = NESSettings.read(folder)
    state = NESState.load(path, settings.task, SEHyperparameters(**settings.se))
    if not state.records:
        return f"0/{generations} generations", ""
    return f"{state.generation}/{generations} generations", f"{state.best_score:.1f}"


def _evaluation(folder: Path, agents: int) -> tuple[str, str]:
    settings = EvaluationSettings.read(folder)
    total = agents * len(settings.sources) * len(settings.kinds)
    return f"{len(Lines(folder / RESULTS_FILE).values)}/{total} agents", ""
