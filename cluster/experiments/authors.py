"""The paper's and the authors' figures from `authors.json`, compared with ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

from bilevel.decode import decode_json
from cluster.experiments.conditions import REAL, title_of
from cluster.experiments.table import Row, Value, heading, with_spread

#: Columns of a summary that name the condition of its SEs.
CONDITION = ("source", "condition")

#: SEs that the authors chose for their best result of TD3.
PICKED = 5


@dataclass(frozen=True)
class AuthorsFigure:
    """A figure of theirs, with the comparable row and column of our experiment's summary."""

    task: str
    experiment: str
    row: dict[str, str]  # columns that identify the row in the summary
    what: str  # column
    value: float
    spread: float | None  # standard deviation
    behind: str  # number of evaluations
    source: str  # the paper, or their repository, automl/learning_environments
    note: str


def authors_figures() -> tuple[AuthorsFigure, ...]:
    """Read the data file `authors.json`."""
    text = files(__package__).joinpath("authors.json").read_text()
    return decode_json(tuple[AuthorsFigure, ...], text, "authors.json")


def comparison(task_id: str, summaries: Mapping[str, Sequence[Row]]) -> list[Row]:
    """Return the authors' figures on a task next to ours, in the same condition and with our
    default recipe. `summaries` are those of finished experiments by name."""
    return [
        {
            "experiment": figure.experiment,
            "condition": "; ".join(map(str, titled(figure.row).values())),
            "figure": heading(figure.what),
            "authors": with_spread({"x": figure.value, "x_std": figure.spread}, "x"),
            "evaluations (authors)": figure.behind,
            "ours, same condition": _ours(figure, figure.row, summaries),
            "ours, default recipe": _ours(figure, _with_default(figure.row), summaries),
            "source, remarks": "; ".join(filter(None, (figure.source, figure.note))),
        }
        for figure in authors_figures()
        if figure.task == task_id
    ]


def titled(row: Row) -> dict[str, Value]:
    """Return the row with the titles of conditions."""
    return {n: title_of(str(v)) if n in CONDITION else v for n, v in row.items()}


def _with_default(row: Mapping[str, str]) -> dict[str, str] | None:
    """Return the row with the default recipe; None for the real task, which has none."""
    if row.get("source") == REAL:
        return None
    return {name: "default" if name in CONDITION else value for name, value in row.items()}


def _ours(
    figure: AuthorsFigure, row: Mapping[str, str] | None, summaries: Mapping[str, Sequence[Row]]
) -> str:
    found = (
        with_spread(ours, figure.what)
        for ours in summaries.get(figure.experiment, ())
        if row is not None and ours.items() >= row.items()
    )
    return next(found, "-")
