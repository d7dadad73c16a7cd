"""The tables of NES over seeds, from the committed results of `benchmarks.nes.seeds`."""

import statistics
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from scipy.stats import spearmanr, wilcoxon

from benchmarks.arguments import parse_seeds
from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import mean_and_range, median_and_range, number_and_interval, source, table
from benchmarks.nes.run import core_seconds_per_se

#: Target mean score of each kind of agent on an SE, by task; `sb3` is for agents of
#: Stable-Baselines3.
TARGETS: dict[str, dict[str, float]] = {
    "CartPole-v0": {"ddqn": 195, "dueling-ddqn": 195, "td3": 170, "sb3": 190},
    "Acrobot-v1": {"ddqn": -90, "dueling-ddqn": -90, "td3": -100, "sb3": -100},
    "MountainCar-v0": {"ddqn": -110, "dueling-ddqn": -110, "td3": -110, "sb3": -110},
}

#: The paper's tasks, and another one.
PAPER_TASKS, OTHER_TASKS = ("CartPole-v0", "Acrobot-v1"), ("MountainCar-v0",)

#: Seeds from which on numbers of random steps are compared.
_FEWEST = 4

_SEEDS = (
    "task",
    "solved, 95% interval",
    "confirmed",
    "seconds to confirmed SE",
    "seconds in all",
    "core seconds",
    "generations",
    "train steps of an agent",
    "million real steps",
    "core utilisation in generations",
)

_TAUGHT = (
    "task",
    "agent",
    "SEs",
    "agents per SE",
    "score",
    "SEs at or above the target",
    "train steps",
)


def seeds(ending: str = "", tasks: Sequence[str] = PAPER_TASKS) -> str:
    """Runs over seeds, one row per task."""
    results = _results(ending, tasks)
    rows = [_seeds_row(task, result["runs"]) for task, result in results.items()]
    return f"{table(_SEEDS, rows)}\n\n{source(*results.values())}"


def taught(ending: str = "", tasks: Sequence[str] = PAPER_TASKS) -> str:
    """Agents trained on the SEs, one row per task and kind of agent. Raises NotMeasured without
    any."""
    results = _results(ending, tasks)
    rows = [row for task, result in results.items() for row in _taught_rows(task, result["runs"])]
    if not rows:
        raise NotMeasured("agents on the SEs of these runs")
    return f"{table(_TAUGHT, rows)}\n\n{source(*results.values())}"


def distilled() -> str:
    """Both tables for runs that start from distilled SEs."""
    return _both("_distilled", PAPER_TASKS)


def longer() -> str:
    """Both tables for SEs of longer episodes, of the task whose SEs teach TD3 little otherwise."""
    return _both("_default-se.spread-1.06-se.step_limit-100", ("Acrobot-v1",))


def others() -> str:
    """Both tables for a task outside the paper."""
    return _both("", OTHER_TASKS)


def scale() -> str:
    """NES with the scale of observations measured over more and fewer random steps. An error is the
    distance of a mean from that of all runs with most steps, in deviations."""
    results = {}
    for task in PAPER_TASKS:
        with suppress(NotMeasured):
            results[task] = read_result(f"nes_scale_{task}", "runs")
    if not results:
        raise NotMeasured("`benchmarks/results/nes_scale_*.json`")
    rows = [row for task, result in results.items() for row in scale_rows(task, result["runs"])]
    head = [
        "task",
        "random steps",
        "solved",
        "core seconds per SE",
        "core seconds, median and range",
        "p against the first row",
        "largest error of a mean, median and maximum over seeds",
        "rank correlation of each mean's error with core seconds",
    ]
    return f"{table(head, rows)}\n\n{source(*results.values())}"


def scale_rows(task: str, runs: Sequence[dict[str, Any]]) -> list[list[str]]:
    """The rows of a task, by the seeds that ran with every number of steps."""
    by_steps: dict[int, dict[int, dict[str, Any]]] = {}
    for run in runs:
        by_steps.setdefault(run["steps"], {})[run["seed"]] = run
    common = sorted(set.intersection(*(set(found) for found in by_steps.values())))
    if len(common) < _FEWEST:
        return []
    most = by_steps[max(by_steps)].values()
    exact, deviation = (np.mean([run[name] for run in most], 0) for name in ("mean", "deviation"))
    rows: list[list[str]] = []
    first: list[float] = []
    for steps, found in sorted(by_steps.items()):
        chosen = [found[seed] for seed in common]
        costs = [run["core_seconds"] for run in chosen]
        errors = np.abs([np.array(run["mean"]) - exact for run in chosen]) / deviation
        agreement = [float(spearmanr(of_mean, costs).statistic) for of_mean in errors.T]
        p = f"{wilcoxon(np.log(first), np.log(costs)).pvalue:.2g}" if first else ""
        rows.append(
            [
                task,
                f"{steps:,}".replace(",", " "),
                f"{sum(run['solved'] for run in chosen)} of {len(chosen)}",
                f"{core_seconds_per_se(chosen):.0f}",
                median_and_range(costs),
                p,
                f"{np.median(errors.max(1)):.2f}, {errors.max():.2f}",
                ", ".join(f"{one:.2f}" for one in agreement),
            ]
        )
        first = first or costs
    return rows


def _both(ending: str, tasks: Sequence[str]) -> str:
    parts = [seeds(ending, tasks)]
    with suppress(NotMeasured):
        parts.append(taught(ending, tasks))
    return "\n\n".join(parts)


def _results(ending: str, tasks: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The measured results, by task. Raises NotMeasured if there are none.

    A measurement that did not come to its end counts as none: the seeds that it lacks may be those
    that take longest.
    """
    found, missing = {}, []
    for task in tasks:
        name = f"nes_seeds_{task}{ending}"
        try:
            result = read_result(name, "runs")
        except NotMeasured as error:
            missing.append(str(error))
            continue
        asked = result["command"].partition("--seeds ")[2].partition(" --")[0]
        if parse_seeds(asked) == [run["seed"] for run in result["runs"]]:
            found[task] = result
        else:
            missing.append(f"some seeds of `benchmarks/results/{name}.json`")
    if not found:
        raise NotMeasured(", ".join(missing))
    return found


def _seeds_row(task: str, runs: Sequence[dict[str, Any]]) -> list[str]:
    utilisation = statistics.median(run["core_utilisation"] for run in runs)
    confirmed = [run["seconds_to_se"] for run in runs if run["confirmed"]]
    return [
        task,
        number_and_interval(sum(run["solved"] for run in runs), len(runs)),
        f"{len(confirmed)} of {len(runs)}",
        median_and_range(confirmed) if confirmed else "-",
        median_and_range([run["seconds"] for run in runs]),
        median_and_range([run["core_seconds"] for run in runs]),
        median_and_range([run["generations"] for run in runs]),
        median_and_range([run["final_train_steps"] for run in runs]),
        median_and_range([run["real_env_steps"] / 1e6 for run in runs], ".1f"),
        f"{utilisation:.0%}",
    ]


def _taught_rows(task: str, runs: Sequence[dict[str, Any]]) -> list[list[str]]:
    rows = []
    lessons = [run["taught"] for run in runs if "taught" in run]
    for kind in dict.fromkeys(kind for lesson in lessons for kind in lesson):
        on_ses = [lesson[kind] for lesson in lessons if kind in lesson]
        means = [statistics.mean(on_se["scores"]) for on_se in on_ses]
        target = TARGETS[task][kind.split()[0].rstrip(",")]
        steps = [step for on_se in on_ses for step in on_se.get("train_steps", ())]
        numbers = sorted({len(on_se["scores"]) for on_se in on_ses})
        rows.append(
            [
                task,
                kind,
                str(len(on_ses)),
                " or ".join(map(str, numbers)),
                mean_and_range(means),
                f"{sum(mean >= target for mean in means)} (target {target:g})",
                f"{statistics.mean(steps):.0f}" if steps else "-",
            ]
        )
    return rows


TABLES: dict[str, Callable[[], str]] = {
    "nes-seeds": seeds,
    "nes-taught": taught,
    "nes-longer": longer,
    "nes-scale": scale,
    "nes-distilled": distilled,
}
