"""Long searches for better defaults: what they found, beside the recipe `default`.

The studies lie in `studies`, a home without checkpoints and MLflow's database; `bilevel sync NAME
--home benchmarks/search/studies` shows one in MLflow. The recipes beside it are those that a search
began with or led to, other than the defaults of today. `benchmarks.nes.seeds` runs all of them over
seeds that no choice was made on.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import fisher_exact, mannwhitneyu

from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import mean_and_range, source, table
from benchmarks.nes.run import core_seconds_per_se
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.study.definition import Study, configuration_name
from cluster.bohb.study.journal import Journal, Origin, ResultLine

STUDIES = Path(__file__).parent / "studies"
#: Recipes of a task in the order in which they came about, and the endings of their results over
#: seeds. Each is compared with the first. All ran while 1000 random steps measured the scale of
#: observations; the recipes `default` have run again since.
RECIPES = {
    "CartPole-v0": {
        "made by hand": "_by-hand",
        "first search, best result": "_unvalidated",
        "first search, incumbent": "_found",
        "second search, incumbent": "_scale-1000",
    },
    "Acrobot-v1": {"made by hand": "_by-hand", "search, incumbent": "_scale-1000"},
}
TASKS = tuple(RECIPES)

#: What `benchmarks.search.compare` has measured, by what the tables call it: while 1000 random
#: steps measured the scale of observations, and as it is today.
COMPARISONS = {
    f"{task}{title}": f"search_{task}{ending}"
    for task in TASKS
    for title, ending in ((", scale of 1000 steps", "_scale-1000"), ("", ""))
}


def comparisons() -> dict[str, dict[str, Any]]:
    """Those of them that are there, by the same titles. Raises NotMeasured without any."""
    found = {}
    for title, name in COMPARISONS.items():
        with suppress(NotMeasured):
            found[title] = read_result(name, "rows")
    if not found:
        raise NotMeasured("`benchmarks/results/search_*.json`")
    return found


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


#: Objective of a result, and the number of its confirmed SEs.
Outcome = tuple[float, int]
#: The outcomes of configurations by their origin.
ByOrigin = dict[str, list[Outcome]]


def outcomes(journal: Journal, at_budget: bool = False) -> dict[str, ByOrigin]:
    """The results of a search by budget, the smallest first, and by the origin of their
    configurations, but for the recipe itself; the objective of a failure is infinite. `at_budget`
    scales objectives as if each had cost its budget: all outrun it by a part of a generation, those
    with large generations by more."""
    proposals = journal.proposals
    found: dict[str, ByOrigin] = {
        str(budget): {
            origin.value: [] for origin in (Origin.RANDOM, Origin.AROUND_RECIPE, Origin.MODEL)
        }
        for budget in sorted({line.budget for line in journal.results})
    }
    for line in journal.results:
        if proposals[line.id].origin is not Origin.RECIPE:
            objective = math.inf if line.loss is None else line.loss
            if at_budget and "core_seconds" in line.info:
                objective *= line.budget / line.info["core_seconds"]
            outcome = objective, line.info.get("confirmed", 0)
            found[str(line.budget)][proposals[line.id].origin.value].append(outcome)
    return found


def at_smallest(by_budget: Mapping[str, ByOrigin]) -> ByOrigin:
    """The outcomes at the smallest budget, which every configuration gets."""
    return by_budget[min(by_budget, key=int)]


def at_largest(by_budget: Mapping[str, ByOrigin]) -> ByOrigin:
    """The outcomes at the largest budget, which all but random search give to the best only."""
    return by_budget[max(by_budget, key=int)]


def with_an_se(found: Sequence[Outcome]) -> int:
    """How many of these configurations have found an SE."""
    return sum(confirmed > 0 for _, confirmed in found)


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
    if len(searches) > 1:
        exchanged = np.array([*product((-1, 1), repeat=len(better))]) @ (np.array(better) - 0.5)
        p = float(np.mean(np.abs(exchanged) >= np.abs(exchanged[-1]) - 1e-12))
    return f"{np.mean(better):.0%}", f"{p:.1g}"


def quartiles(values: Sequence[float]) -> str:
    """The median, with the quartiles."""
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    return f"{middle:.0f} ({low:.0f} to {high:.0f})"


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


def measured(task: str) -> dict[str, Any]:
    """The runs over seeds of a task's recipes, by their titles; none if there is one recipe."""
    results = {}
    for title, ending in RECIPES[task].items():
        with suppress(NotMeasured):
            results[title] = read_result(f"nes_seeds_{task}{ending}", "runs")
    return results if len(results) > 1 else {}


def found() -> str:
    """The recipes that searches began with and led to, over fresh seeds."""
    rows: list[tuple[str, ...]] = []
    sources: list[dict[str, Any]] = []
    for task in RECIPES:
        results = measured(task)
        first: list[dict[str, Any]] | None = None
        for title, result in results.items():
            runs = result["runs"]
            p = _p_values(first, runs) if first else ("", "")
            rows.append((task, title, *_quality(runs), *p))
            first = first or runs
        sources += results.values()
    if not rows:
        raise NotMeasured("recipes of `benchmarks/search` over seeds")
    head = [
        "task",
        "recipe",
        "solved",
        "confirmed",
        "confirmed runs that solve the task",
        "core seconds, median and range",
        "core seconds per SE",
        "train steps of an agent",
        "p of core seconds",
        "p of solved",
    ]
    return f"{table(head, rows)}\n\n{source(*sources)}"


def found_taught() -> str:
    """What the SEs of these recipes teach, a column for each recipe on whose SEs agents were
    trained. Raises NotMeasured."""
    parts = []
    for task in RECIPES:
        lessons = {
            title: [run["taught"] for run in result["runs"] if "taught" in run]
            for title, result in measured(task).items()
        }
        lessons = {title: taught for title, taught in lessons.items() if taught}
        if lessons:
            parts.append(_taught(task, lessons))
    if not parts:
        raise NotMeasured("agents on the SEs of recipes of `benchmarks/search`")
    return "\n\n".join(parts)


def _taught(task: str, lessons: dict[str, list[dict[str, Any]]]) -> str:
    rows = []
    for kind in dict.fromkeys(kind for taught in lessons.values() for on in taught for kind in on):
        cells = []
        for taught in lessons.values():
            means = [float(np.mean(on_se[kind]["scores"])) for on_se in taught if kind in on_se]
            cells.append(mean_and_range(means) if means else "-")
        rows.append((task, kind, *cells))
    head = ["task", "agent", *(f"{title}: {len(on)} SEs" for title, on in lessons.items())]
    return table(head, rows)


def _p_values(one: list[dict[str, Any]], other: list[dict[str, Any]]) -> tuple[str, str]:
    costs = [
        [run["core_seconds"] if run["confirmed"] else np.inf for run in runs]
        for runs in (one, other)
    ]
    solved = [sum(run["solved"] for run in runs) for runs in (one, other)]
    missed = [len(runs) - n for runs, n in zip((one, other), solved, strict=True)]
    p = mannwhitneyu(*costs).pvalue, fisher_exact([solved, missed]).pvalue
    return f"{p[0]:.1g}", f"{p[1]:.1g}"


def _quality(runs: list[dict[str, Any]]) -> tuple[str, ...]:
    costs = [run["core_seconds"] for run in runs]
    confirmed = sum(run["confirmed"] for run in runs)
    return (
        f"{sum(run['solved'] for run in runs)} of {len(runs)}",
        f"{confirmed} of {len(runs)}",
        f"{sum(run['solved'] and run['confirmed'] for run in runs)} of {confirmed}",
        f"{np.median(costs):.0f} ({min(costs):.0f} to {max(costs):.0f})",
        f"{core_seconds_per_se(runs):.0f}",
        f"{np.median([run['final_train_steps'] for run in runs]):.0f}",
    )
