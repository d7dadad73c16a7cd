"""The tables of docs/search.md, from the committed results."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import binomtest, spearmanr

from benchmarks.machine import read_result, spread
from benchmarks.markdown import source, table
from bilevel.tasks import get_task
from cluster.profiles import METHODS

#: Tasks whose searches are compared.
TASKS = ("CartPole-v0",)

_HEADER = (
    "method",
    "good configuration found",
    "good SE",
    "best objective",
    "fitness",
    "test return",
    "train steps",
    "fully varied agents",
    "their steps",
    "configurations",
    "by the model",
    "results at the largest budget",
    "good ones",
)


def is_good(study: dict[str, Any], solved_reward: float) -> bool:
    """Whether its SE solves the task when train steps are paid for."""
    good: bool = study["own"]["fitness_mean"] >= solved_reward
    return good


def first_results(study: dict[str, Any]) -> list[dict[str, Any]]:
    """Of every configuration the one that came first, before any was promoted; with
    `model_based`, whether the model proposed it. Failures are left out."""
    picks = {line["name"]: line["model_based"] for line in study["configurations"]}
    first: dict[str, dict[str, Any]] = {}
    for line in study["results"]:
        first.setdefault(line["configuration"], line)
    return [
        {**line, "model_based": picks[name]}
        for name, line in first.items()
        if line["objective"] is not None
    ]


def at_the_largest_budget(study: dict[str, Any]) -> list[dict[str, Any]]:
    """Results without failures, in the order in which they came."""
    largest = max(study["budgets"])
    return [r for r in study["results"] if r["budget"] == largest and r["objective"] is not None]


def good_configurations(study: dict[str, Any], solved_reward: float) -> int:
    """How many results solve the task when train steps are paid for, as fitness does, in all
    generations of the largest budget on average."""
    found = at_the_largest_budget(study)
    return sum(line["objective"] >= solved_reward for line in found)


def incumbents(study: dict[str, Any]) -> list[tuple[float, float]]:
    """Minutes and objective of each result at the largest budget that was better than all
    before."""
    found: list[tuple[float, float]] = []
    for line in at_the_largest_budget(study):
        if not found or line["objective"] > found[-1][1]:
            found.append((line["minutes"], line["objective"]))
    return found


def method_row(
    method: str, studies: Sequence[dict[str, Any]], solved_reward: float
) -> list[object]:
    """One method: medians over its studies, with the lowest and the highest."""

    def column(form: str, value: Callable[[dict[str, Any]], float]) -> str:
        found = spread([value(study) for study in studies])
        return f"{found['median']:{form}} ({found['low']:{form}} to {found['high']:{form}})"

    good = [good_configurations(study, solved_reward) for study in studies]
    return [
        METHODS[method],
        f"{sum(map(bool, good))} of {len(studies)}",
        f"{sum(is_good(study, solved_reward) for study in studies)} of {len(studies)}",
        column(".1f", _found),
        column(".1f", lambda study: study["own"]["fitness_mean"]),
        column(".1f", lambda study: study["own"]["score_mean"]),
        column(".0f", lambda study: study["own"]["train_steps_mean"]),
        column(".1f", lambda study: study["varied"]["score_mean"]),
        column(".0f", lambda study: study["varied"]["train_steps_mean"]),
        column(".0f", lambda study: len(study["configurations"])),
        column(".0f", lambda study: sum(c["model_based"] for c in study["configurations"])),
        column(".0f", lambda study: len(at_the_largest_budget(study))),
        column(".0f", lambda study: good_configurations(study, solved_reward)),
    ]


def by_method(result: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """The studies of each method that has any."""
    found = {
        method: [study for study in result["studies"] if study["method"] == method]
        for method in METHODS
    }
    return {method: studies for method, studies in found.items() if studies}


def by_start(studies: Sequence[dict[str, Any]]) -> dict[int, list[dict[str, Any]]]:
    """By seed, and so by start: all configurations that were proposed from there and finished
    the smallest budget, each once."""
    least = min(min(study["budgets"]) for study in studies)
    found: dict[int, dict[str, dict[str, Any]]] = {}
    for study in studies:
        runs = found.setdefault(study["seed"], {})
        for run in study["configurations"]:
            if len(run["fitness"]) >= least:
                runs.setdefault(str(run["values"]), run)
    return {seed: list(runs.values()) for seed, runs in found.items()}


def _found(study: dict[str, Any]) -> float:
    """The objective of its best configuration; that of none is lower than any."""
    return max((line["objective"] for line in at_the_largest_budget(study)), default=-np.inf)


def _signs(ours: Sequence[float], theirs: Sequence[float]) -> str:
    """How often ours are more than theirs, and less."""
    more = sum(one > other for one, other in zip(ours, theirs, strict=True))
    less = sum(one < other for one, other in zip(ours, theirs, strict=True))
    p = binomtest(more, more + less).pvalue if more + less else 1.0
    return (
        f"higher from {more}, lower from {less} and the same from {len(ours) - more - less} "
        f"(sign test: p = {p:.2f})"
    )


def against_random(
    name: str,
    studies: Sequence[dict[str, Any]],
    others: Sequence[dict[str, Any]],
    solved_reward: float,
) -> str:
    """Seed by seed, as the studies of a seed begin alike."""
    by_seed = {study["seed"]: study for study in others}
    pairs = [(study, by_seed[study["seed"]]) for study in studies]
    objectives = _signs(*zip(*[(_found(a), _found(b)) for a, b in pairs], strict=True))
    good = [tuple(good_configurations(one, solved_reward) for one in pair) for pair in pairs]
    fitness = [(a["own"]["fitness_mean"], b["own"]["fitness_mean"]) for a, b in pairs]
    return (
        f"Beside random search, of {len(pairs)} seeds, the objective of {METHODS[name]}'s best "
        f"configuration is {objectives}, the number of good configurations "
        f"{_signs(*zip(*good, strict=True))}, and the fitness of the SE that is handed over "
        f"{_signs(*zip(*fitness, strict=True))}."
    )


def proposals(name: str, studies: Sequence[dict[str, Any]]) -> str:
    """What the model proposed beside what was drawn, by the first result of either."""
    first = [line for study in studies for line in first_results(study)]
    by_model, drawn = (
        [line["objective"] for line in first if line["model_based"] == kind]
        for kind in (True, False)
    )
    if not by_model:
        return f"{METHODS[name]}'s model proposed nothing."
    return (
        f"The first objectives of the {len(by_model)} configurations that {METHODS[name]}'s model "
        f"proposed have a median of {np.median(by_model):.1f}, of the {len(drawn)} drawn at random "
        f"{np.median(drawn):.1f}."
    )


def methods(task: str) -> str:
    """All methods on a task, and how often each was better than random search."""
    result = read_result(f"search_{task}", "studies")
    solved_reward = get_task(task).solved_reward
    groups = by_method(result)
    rows = [method_row(name, studies, solved_reward) for name, studies in groups.items()]
    told = [
        (f"{proposals(name, found)} " if name == "bohb" else "")
        + against_random(name, found, groups["random"], solved_reward)
        for name, found in groups.items()
        if name != "random"
    ]
    agents = result["studies"][0]
    about = (
        f"Medians over studies, with the lowest and the highest; {agents['own']['agents']} fresh "
        f"agents on each best SE, {agents['varied']['agents']} fully varied ones."
    )
    return table(_HEADER, rows) + f"\n\n{' '.join(told)} {about}\n{source(result)}"


def correlation(runs: Sequence[dict[str, Any]], generations: int) -> float:
    """Spearman's, of the runs' mean fitness over so many generations with that over all."""
    early = [np.mean(run["fitness"][:generations]) for run in runs]
    return float(spearmanr(early, [np.mean(run["fitness"]) for run in runs]).statistic)


def rungs(task: str) -> str:
    """What a run's first generations tell of all of them; of the configurations of random
    search, which all run to the largest budget."""
    result = read_result(f"search_{task}", "studies")
    largest = max(result["studies"][0]["budgets"])
    studies = [
        [run for run in study["configurations"] if len(run["fitness"]) == largest]
        for study in by_method(result)["random"]
    ]
    rows = []
    for generations in range(1, largest):
        found = spread([correlation(runs, generations) for runs in studies])
        cells = f"{found['median']:.2f} ({found['low']:.2f} to {found['high']:.2f})"
        rows.append([generations, cells])
    about = (
        f"{sum(map(len, studies))} configurations from {len(studies)} starts; the median over "
        "starts, the lowest and the highest."
    )
    return table(("generations", f"rank correlation with all {largest}"), rows) + f"\n\n{about}"


TABLES: dict[str, Callable[[], str]] = {
    f"{name}-{task}": partial(content, task)
    for task in TASKS
    for name, content in (("search", methods), ("rungs", rungs))
}
