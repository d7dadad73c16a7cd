"""The paper's and the authors' figures from `authors.json`, compared with ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

from bilevel.decode import decode_json
from cluster.evaluate.report import Row, Value, heading, with_spread
from cluster.experiments.conditions import REAL, title_of

#: Columns of a summary that name the condition of its SEs.
CONDITION = ("source", "condition")


@dataclass(frozen=True)
class AuthorsFigure:
    """A figure of theirs, with the comparable row and column of our experiment's summary."""

    task: str
    experiment: str
    row: dict[str, str]  # columns that identify the row in the summary
    what: str  # column
    value: float
    spread: float | None  # standard deviation
    evaluations: str  # their number
    source: str  # the paper, or their repository, automl/learning_environments
    note: str


def authors_figures() -> tuple[AuthorsFigure, ...]:
    """Read the data file `authors.json`."""
    text = files(__package__).joinpath("authors.json").read_text()
    return decode_json(tuple[AuthorsFigure, ...], text, "authors.json")


def comparison(task_id: str, summaries: Mapping[str, Sequence[Row]]) -> list[Row]:
    """Return the authors' figures on a task next to ours, in the same condition and with our
    default recipe. `summaries` are those of finished experiments by name."""
    rows: list[Row] = []
    for figure in authors_figures():
        if figure.task != task_id:
            continue
        row, ours = figure.row, summaries.get(figure.experiment, ())
        default = {name: "default" if name in CONDITION else value for name, value in row.items()}
        rows.append(
            {
                "experiment": figure.experiment,
                "condition": "; ".join(map(str, titled(row).values())),
                "figure": heading(figure.what),
                "authors": with_spread({"x": figure.value, "x_std": figure.spread}, "x"),
                "evaluations (authors)": figure.evaluations,
                "ours, same condition": _value(ours, row, figure.what),
                "ours, default recipe": "-"
                if row.get("source") == REAL
                else _value(ours, default, figure.what),
                "source, remarks": "; ".join(filter(None, (figure.source, figure.note))),
            }
        )
    return rows


def titled(row: Row) -> dict[str, Value]:
    """Return the row with the titles of conditions."""
    return {n: title_of(str(v)) if n in CONDITION else v for n, v in row.items()}


def _value(summary: Sequence[Row], row: Mapping[str, str], what: str) -> str:
    return next((with_spread(one, what) for one in summary if one.items() >= row.items()), "-")
