"""Tables of the committed studies, which searched for better defaults.

Each folder in `studies` contains the journal, the validation and the search space of a study.
"""

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import mannwhitneyu

from benchmarks.machine import NotMeasured
from benchmarks.markdown import table
from benchmarks.search.comparison import comparisons
from benchmarks.search.outcomes import ByOrigin, at_smallest, outcomes, quartiles, with_an_se
from benchmarks.search.recipes import TASKS
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import Journal, Origin, ResultLine

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
                cost(study.points()[-1].spent, study.journal.results),
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


def validations() -> str:
    """Return the table of the finalists over new seeds."""
    head = (
        "task",
        "study",
        "configuration",
        "SEs in the search",
        "in the validation",
        "objective in the search",
        "in the validation",
    )
    rows = []
    for study in committed():
        for line in study.finalists:
            lines = study.result_of(line.id), line
            recipe = line.id == study.journal.recipe
            rows.append(
                (
                    *_name(study),
                    "the recipe" if recipe else configuration_name(line.id),
                    *(
                        f"{one.info['confirmed']} in {one.info['core_seconds']:.0f} core s"
                        for one in lines
                    ),
                    *(f"{one.loss:.0f}" for one in lines),
                )
            )
    return table(head, rows)


def proposals() -> str:
    """Return the table of outcomes at the smallest budget by the origin of configurations.

    All BOHB searches of a comparison share their rows, in which each search counts once.
    """
    rows: list[tuple[str, ...]] = []
    for study in committed():
        rows += proposal_rows(*_name(study), [at_smallest(outcomes(study.journal, True))])
    with suppress(NotMeasured):
        for title, result in comparisons().items():
            found = [
                at_smallest(row["search"]["outcomes"])
                for row in result["rows"].values()
                if row.get("method") == "bohb" and "search" in row
            ]
            noun = "search" if len(found) == 1 else "searches"
            if found:
                rows += proposal_rows(title, f"compared below: {len(found)} {noun}", found)
    head = (
        "task",
        "study",
        "configurations",
        "found an SE",
        "objective, median and quartiles",
        "probability of beating a random one",
        "p",
    )
    return table(head, rows)


def proposal_rows(task: str, study: str, searches: Sequence[ByOrigin]) -> list[tuple[str, ...]]:
    """Return one row per origin that proposed configurations."""
    rows: list[tuple[str, ...]] = []
    for origin in searches[0]:
        found = [outcome for search in searches for outcome in search[origin]]
        if found:
            against = (
                ("", "") if origin == Origin.RANDOM.value else _against_random(searches, origin)
            )
            objectives = quartiles([objective for objective, _ in found])
            number = f"{with_an_se(found)} of {len(found)}"
            rows.append((task, study, origin, number, objectives, *against))
    return rows


def _against_random(searches: Sequence[ByOrigin], origin: str) -> tuple[str, str]:
    """Format the probability that a configuration of that origin has a lower objective than a
    random one of the same search, and a two-sided p that it is one half.

    The test is Mann-Whitney for one search, and an exact sign-flip test for several.
    """
    better, p = [], math.nan
    for search in searches:
        ours, random = ([one[0] for one in search[kind]] for kind in (origin, Origin.RANDOM.value))
        if ours and random:
            found = mannwhitneyu(ours, random)
            better.append(1 - float(found.statistic) / (len(ours) * len(random)))
            p = float(found.pvalue)
    if not better:
        return "", ""
    if len(searches) > 1:
        flipped = np.array([*product((-1, 1), repeat=len(better))]) @ (np.array(better) - 0.5)
        p = float(np.mean(np.abs(flipped) >= np.abs(flipped[-1]) - 1e-12))
    return f"{np.mean(better):.0%}", f"{p:.2g}"
