"""Long searches for better defaults, beside the recipe `default`.

The studies lie in `studies`, a home without checkpoints and MLflow's database; `bilevel sync NAME
--home benchmarks/search/studies` shows one in MLflow.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
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
from cluster.bohb.study.definition import Study, configuration_name
from cluster.bohb.study.journal import Journal, Origin, ResultLine

STUDIES = Path(__file__).parent / "studies"


def committed() -> list[Study]:
    """The studies, task by task in the order in which they were begun. Raises NotMeasured without
    any."""
    found = [
        Study.read(settings.parent)
        for task in TASKS
        for settings in STUDIES.glob(f"{task}/*/settings.json")
    ]
    if not found:
        raise NotMeasured("studies in `benchmarks/search/studies`")
    return sorted(
        found, key=lambda study: (TASKS.index(study.task.id), Journal(study.folder).began)
    )


def summary(study: Study) -> StudySummary:
    """What the journal of a study tells."""
    journal = Journal(study.folder)
    brackets = 1 + max(line.id[0] for line in journal.configs)
    return StudySummary.of(journal, study.schedule.brackets(brackets))


def searches() -> str:
    """What each search tried, and what the objectives of its finalists rest on."""
    rows = []
    for study in committed():
        told = summary(study)
        rows.append(
            (
                study.task.id,
                f"`{study.name}`",
                str(len(study.space.build())),
                str(len(told.journal.configs)),
                str(told.model_based),
                *map(str, time_spent(told)),
                _overrun(told.journal.results),
            )
        )
    head = [
        "task",
        "study",
        "hyperparameters",
        "configurations",
        "proposed by the model",
        "search",
        "validation",
        "overrun of the smallest budget, mean and maximum",
    ]
    return table(head, rows)


def _overrun(results: Sequence[ResultLine]) -> str:
    """By how much configurations outran the smallest budget: each ends with a generation."""
    smallest = min(line.budget for line in results)
    spent = [line.info["core_seconds"] for line in results if line.budget == smallest if line.info]
    over = np.array(spent) / smallest - 1
    return f"{over.mean():.0%}, {over.max():.0%}"


@dataclass(frozen=True)
class TimeSpent:
    """What a part of a study took."""

    core: float  # by its budgets
    elapsed: float  # while any of its configurations ran, on as many cores as there were

    def __str__(self) -> str:
        return f"{self.core:.1f} core hours in {60 * self.elapsed:.0f} min"


def time_spent(told: StudySummary) -> tuple[TimeSpent, TimeSpent]:
    """What the search and its validation took."""
    return (
        TimeSpent(told.points()[-1].spent / 3600, _elapsed(told.journal.results)),
        TimeSpent(sum(line.budget for line in told.finalists) / 3600, _elapsed(told.finalists)),
    )


def _elapsed(lines: Sequence[ResultLine]) -> float:
    """Hours in which at least one of these ran."""
    total = end = 0.0
    for begun, finished in sorted((line.timestamps["started"], line.finished) for line in lines):
        total += max(finished - max(begun, end), 0.0)
        end = max(end, finished)
    return total / 3600


def validations() -> str:
    """What became of the finalists over new seeds."""
    rows = []
    for study in committed():
        told = summary(study)
        for line in told.finalists:
            before = told.result_of(line.id)
            recipe = line.id == told.journal.recipe
            rows.append(
                (
                    study.task.id,
                    f"`{study.name}`",
                    "the recipe" if recipe else configuration_name(line.id),
                    *(
                        f"{one.info['confirmed']} in {one.info['core_seconds']:.0f} core s"
                        for one in (before, line)
                    ),
                    f"{before.loss:.0f}",
                    f"{line.loss:.0f}",
                )
            )
    head = [
        "task",
        "study",
        "configuration",
        "SEs in the search",
        "in the validation",
        "objective in the search",
        "in the validation",
    ]
    return table(head, rows)


def proposals() -> str:
    """How the configurations of each origin did at the smallest budget, where all of them were
    run: in each study, and in all searches by BOHB of the comparison, which count once each."""
    rows = [
        row
        for study in committed()
        for row in _proposals(
            study.task.id, f"`{study.name}`", [at_smallest(outcomes(Journal(study.folder), True))]
        )
    ]
    with suppress(NotMeasured):
        for title, result in comparisons().items():
            found = [
                at_smallest(row["search"]["outcomes"])
                for row in result["rows"].values()
                if row.get("method") == "bohb" and "search" in row
            ]
            noun = "search" if len(found) == 1 else "searches"
            if found:
                rows += _proposals(title, f"compared below: {len(found)} {noun}", found)
    head = [
        "task",
        "study",
        "configurations",
        "found an SE",
        "objective, median and quartiles",
        "probability of beating a random one",
        "p",
    ]
    return table(head, rows)


def _proposals(task: str, study: str, searches: Sequence[ByOrigin]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for origin in searches[0]:
        found = [outcome for search in searches for outcome in search[origin]]
        if found:
            told = ("", "") if origin == Origin.RANDOM.value else _against_random(searches, origin)
            objectives = quartiles([objective for objective, _ in found])
            number = f"{with_an_se(found)} of {len(found)}"
            rows.append((task, study, origin, number, objectives, *told))
    return rows


def _against_random(searches: Sequence[ByOrigin], origin: str) -> tuple[str, str]:
    """Chance that the objective of a configuration of that origin is lower than that of one drawn
    at random in the same search, and a two-sided p that it is one half: of one search by
    Mann-Whitney, of several by exchange within each."""
    better, p = [], math.nan
    for search in searches:
        ours, random = ([one[0] for one in search[kind]] for kind in (origin, Origin.RANDOM.value))
        if ours and random:
            found = mannwhitneyu(ours, random)
            better.append(1 - float(found.statistic) / (len(ours) * len(random)))
            p = float(found.pvalue)
    if not better:  # no search has both
        return "", ""
    if len(searches) > 1:
        exchanged = np.array([*product((-1, 1), repeat=len(better))]) @ (np.array(better) - 0.5)
        p = float(np.mean(np.abs(exchanged) >= np.abs(exchanged[-1]) - 1e-12))
    return f"{np.mean(better):.0%}", f"{p:.2g}"
