"""The table of searches in README.md, from the committed results."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from scipy.stats import binomtest

from benchmarks.machine import read_result, spread
from benchmarks.markdown import source, table
from bilevel.tasks import get_task
from cluster.profiles import METHODS

#: Tasks whose searches are compared.
TASKS = ("CartPole-v0",)

_HEADER = (
    "method",
    "good SE",
    "fitness",
    "test return",
    "train steps",
    "fully varied agents",
    "their steps",
    "configurations",
    "by the model",
    "results at the largest budget",
)


def is_good(study: dict[str, Any], solved_reward: float) -> bool:
    """Whether its SE solves the task when train steps are paid for."""
    good: bool = study["own"]["fitness_mean"] >= solved_reward
    return good


def method_row(
    method: str, studies: Sequence[dict[str, Any]], solved_reward: float
) -> list[object]:
    """One method: medians over its studies, with the lowest and the highest."""

    def column(form: str, *path: str) -> str:
        values = []
        for study in studies:
            value: Any = study
            for part in path:
                value = value[part]
            values.append(value)
        found = spread(values)
        return f"{found['median']:{form}} ({found['low']:{form}} to {found['high']:{form}})"

    return [
        METHODS[method],
        f"{sum(is_good(study, solved_reward) for study in studies)} of {len(studies)}",
        column(".1f", "own", "fitness_mean"),
        column(".1f", "own", "score_mean"),
        column(".0f", "own", "train_steps_mean"),
        column(".1f", "varied", "score_mean"),
        column(".0f", "varied", "train_steps_mean"),
        column(".0f", "configurations"),
        column(".0f", "model_based"),
        column(".0f", "at_the_largest_budget"),
    ]


def by_method(result: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """The studies of each method that has any."""
    found = {
        method: [study for study in result["studies"] if study["method"] == method]
        for method in METHODS
    }
    return {method: studies for method, studies in found.items() if studies}


def against_random(
    name: str, studies: Sequence[dict[str, Any]], others: Sequence[dict[str, Any]]
) -> str:
    """Seed by seed, as the studies of a seed begin alike."""
    ours, theirs = (
        {study["seed"]: study["own"]["fitness_mean"] for study in of} for of in (studies, others)
    )
    differences = [ours[seed] - theirs[seed] for seed in ours]
    more, less = sum(d > 0 for d in differences), sum(d < 0 for d in differences)
    p = binomtest(more, more + less).pvalue if more + less else 1.0
    return (
        f"Of {len(differences)} seeds {METHODS[name]} found a fitter SE than random search from "
        f"{more}, a less fit one from {less}, and the same from {len(differences) - more - less} "
        f"(sign test: p = {p:.2f})."
    )


def methods(task: str) -> str:
    """All methods on a task, and how often each was better than random search."""
    result = read_result(f"search_{task}", "studies")
    solved_reward = get_task(task).solved_reward
    groups = by_method(result)
    rows = [method_row(name, studies, solved_reward) for name, studies in groups.items()]
    pairs = [
        against_random(name, groups[name], groups["random"]) for name in groups if name != "random"
    ]
    agents = result["studies"][0]
    about = (
        f"Medians over studies, with the lowest and the highest; {agents['own']['agents']} fresh "
        f"agents on each best SE, {agents['varied']['agents']} fully varied ones."
    )
    return table(_HEADER, rows) + f"\n\n{' '.join(pairs)} {about}\n{source(result)}"


TABLES: dict[str, Callable[[], str]] = {f"search-{task}": partial(methods, task) for task in TASKS}
