"""The paper's and the authors' figures, from the data file beside this module, and ours beside
them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

from bilevel.decode import decode_json
from cluster.experiments.conditions import title_of
from cluster.experiments.table import Row, Value, heading, shown
from cluster.session.terminal import count

#: Columns of a summary that say how its SEs were learned.
CONDITION = ("source", "condition")

#: Generations of the authors' NES runs.
AUTHORS_GENERATIONS = 200

#: SEs that the authors picked for their best result of TD3.
PICKED = 5


@dataclass(frozen=True)
class AuthorsFigure:
    """One of their figures, and the row and column of our experiment's summary that it is
    comparable with."""

    task: str
    experiment: str
    row: dict[str, str]  # columns that identify the row in the summary
    what: str  # column
    value: float
    spread: float | None  # standard deviation
    behind: str  # number of evaluations behind it
    source: str  # the paper, or their repository, automl/learning_environments
    note: str


def authors_figures() -> tuple[AuthorsFigure, ...]:
    """Read the data file `authors.json`."""
    text = files(__package__).joinpath("authors.json").read_text()
    return decode_json(tuple[AuthorsFigure, ...], text, "authors.json")


def authors_figure(
    task_id: str, experiment: str, row: Mapping[str, str], what: str
) -> AuthorsFigure | None:
    """Their figure of that column and row; None if there is none."""
    wanted = (task_id, experiment, row, what)
    found = (f for f in authors_figures() if (f.task, f.experiment, f.row, f.what) == wanted)
    return next(found, None)


def comparison(task_id: str, summaries: Mapping[str, Sequence[Row]]) -> list[Row]:
    """Their figures on a task beside ours: in the same condition, and with our default recipe.

    `summaries` are those of the experiments that have been run, by name.
    """
    rows: list[Row] = []
    for figure in authors_figures():
        if figure.task != task_id:
            continue
        ours = summaries.get(figure.experiment, ())
        same, default = _same(figure, ours), _default(figure, ours)
        rows.append(
            {
                "experiment": figure.experiment,
                "condition": "; ".join(
                    title_of(value) if name in CONDITION else value
                    for name, value in figure.row.items()
                ),
                "figure": heading(figure.what),
                "authors": _with_spread(figure.value, figure.spread),
                "evaluations (authors)": figure.behind,
                "ours, same condition": _cell(same, figure.what),
                "evaluations (ours)": _behind(same, figure.what),
                "ours, default recipe": _cell(default, figure.what),
                "evaluations (default)": _behind(default, figure.what),
                "source, remarks": "; ".join(part for part in (figure.source, figure.note) if part),
            }
        )
    return rows


def _same(figure: AuthorsFigure, ours: Sequence[Row]) -> Row | None:
    """Our row of the same condition; None for an experiment that has none."""
    if not any(name in figure.row for name in CONDITION):
        return None
    return _row(figure.row, ours)


def _default(figure: AuthorsFigure, ours: Sequence[Row]) -> Row | None:
    """Our row with the default recipe; None for the real task, which has none."""
    if figure.row.get("source") == "real":
        return None
    condition = {name: "default" for name in CONDITION if name in figure.row}
    return _row({**figure.row, **condition}, ours)


def _row(wanted: Mapping[str, str], ours: Sequence[Row]) -> Row | None:
    found = [row for row in ours if all(row.get(k) == v for k, v in wanted.items())]
    return found[0] if found else None


def _cell(row: Row | None, what: str) -> str:
    return "-" if row is None else _with_spread(row.get(what), row.get(f"{what}_std"))


def _with_spread(value: Value, spread: Value) -> str:
    return shown(value) if spread is None else f"{shown(value)} ± {shown(spread)}"


def _behind(row: Row | None, what: str) -> str:
    """Number of evaluations behind one of our figures."""
    if row is None or row.get(what) is None:
        return "-"
    if "runs" in row:
        share = _number(row, "ever_solved") if what == "median_first_solved" else 1.0
        return count(round(share * _number(row, "runs")), "run")
    if what.startswith("train_"):
        return count(round(_number(row, "agents")), "agent")
    share = PICKED / _number(row, "ses") if what == "five_best_ses" else 1.0
    return f"{share * _number(row, 'evaluations'):.0f} test episodes"


def _number(row: Row, name: str) -> float:
    value = row[name]
    assert isinstance(value, int | float)
    return float(value)
