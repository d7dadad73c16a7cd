"""The committed studies, which searched for better defaults.

Each folder in `studies` contains the journal, the validation and the search space of a study.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.markdown import table
from benchmarks.search.recipes import TASKS
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.journal import Journal, ResultLine

STUDIES = Path(__file__).parent / "studies"


def committed() -> list[StudySummary]:
    """Return the studies in chronological order per task."""
    found = [
        (TASKS.index(task), StudySummary.of(Journal(path.parent)))
        for task in TASKS
        for path in STUDIES.glob(f"{task}/*/results.json")
    ]
    return [study for _, study in sorted(found, key=lambda one: (one[0], one[1].journal.began))]


def _name(study: StudySummary) -> tuple[str, str]:
    folder = study.journal.folder
    return folder.parent.name, f"`{folder.name}`"


def searches() -> str:
    """Return the table of the searches: what they tried and what it cost."""
    head = (
        "task",
        "study",
        "hyperparameters",
        "configurations",
        "proposed by the model",
        "search",
        "validation",
        "overrun of the smallest budget, mean and maximum",
    )
    rows = []
    for study in committed():
        space = json.loads((study.journal.folder / "configspace.json").read_text())
        rows.append(
            (
                *_name(study),
                len(space["hyperparameters"]),
                len(study.journal.configs),
                study.model_based,
                cost(study.points()[-1][0], study.journal.results),
                cost(sum(line.budget for line in study.finalists), study.finalists),
                overrun(study.journal.results),
            )
        )
    return table(head, rows)


def overrun(results: Sequence[ResultLine]) -> str:
    """Format by how much results exceed the smallest budget, as each ends with a generation."""
    smallest = min(line.budget for line in results)
    spent = [line.info["core_seconds"] for line in results if line.budget == smallest if line.info]
    over = np.array(spent) / smallest - 1
    return f"{over.mean():.0%}, {over.max():.0%}"


def cost(core_seconds: float, lines: Sequence[ResultLine]) -> str:
    """Format core hours, and the minutes during which at least one of the lines ran."""
    total = end = 0.0
    for started, finished in sorted((line.timestamps["started"], line.finished) for line in lines):
        total += max(finished - max(started, end), 0.0)
        end = max(end, finished)
    return f"{core_seconds / 3600:.1f} core hours in {total / 60:.0f} min"
