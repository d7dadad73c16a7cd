"""Tables of NES over seeds, from the results of `benchmarks.nes.seeds`."""

import statistics
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from benchmarks.machine import NotMeasured, parse_seeds, read_result
from benchmarks.markdown import mean_and_range, median_and_range, number_and_interval, table

#: Target mean score of each kind of agent on an SE, by task; `sb3` are agents of
#: Stable-Baselines3.
TARGETS: dict[str, dict[str, float]] = {
    "CartPole-v0": {"ddqn": 195, "dueling-ddqn": 195, "td3": 170, "sb3": 190},
    "Acrobot-v1": {"ddqn": -90, "dueling-ddqn": -90, "td3": -100, "sb3": -100},
}

PAPER_TASKS = ("CartPole-v0", "Acrobot-v1")
OTHER_TASKS = (
    *("CartPole-v1", "MountainCar-v0", "FrozenLake-v1,is_slippery=False", "LunarLander-v3"),
    *("MountainCarContinuous-v0", "Pendulum-v1", "Swimmer-v5", "HalfCheetah-v5", "Hopper-v5"),
)


def seeds(suffix: str = "", tasks: Sequence[str] = PAPER_TASKS) -> str:
    """Return the table of runs over seeds, one row per task."""
    results = complete_results(suffix, tasks)
    head = (
        "task",
        "solved, 95% interval",
        "confirmed",
        "seconds to confirmed SE",
        "seconds in all",
        "core seconds",
        "generations",
        "train steps of an agent",
        "thousand real steps",
        "core utilisation in generations",
    )
    rows = [_seeds_row(task, result["runs"]) for task, result in results.items()]
    return table(head, rows, *results.values())


def taught(suffix: str = "", tasks: Sequence[str] = PAPER_TASKS) -> str:
    """Return the table of agents trained on the SEs, one row per task and kind of agent.

    Raises NotMeasured if no agents have been trained.
    """
    results = complete_results(suffix, tasks)
    rows = [row for task, result in results.items() for row in _agent_rows(task, result["runs"])]
    if not rows:
        raise NotMeasured("agents on the SEs of these runs")
    head = ["task", "agent", "SEs", "agents per SE", "score"]
    head += ["SEs at or above the target", "train steps"]
    return table(head, rows, *results.values())


def others() -> str:
    """Return the table of tasks outside the paper, one row per task."""
    results = complete_results("", OTHER_TASKS)
    head = "task", "solved", "score", "confirmed", "seconds in all", "thousand real steps"
    rows = []
    for task, result in results.items():
        runs = result["runs"]
        target = next((run["solved_reward"] for run in runs if "solved_reward" in run), None)
        rows.append(
            (
                task if target is None else f"{task} (target {target:g})",
                number_and_interval(sum(run["solved"] for run in runs), len(runs)),
                median_and_range([run["final_score"] for run in runs], ".1f"),
                f"{sum(run['confirmed'] for run in runs)} of {len(runs)}",
                median_and_range([run["seconds"] for run in runs]),
                median_and_range([run["real_env_steps"] / 1e3 for run in runs]),
            )
        )
    return table(head, rows, *results.values())


def complete_results(suffix: str, tasks: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the results by task. Raises NotMeasured if there are none.

    Results with missing seeds are left out, because these may be the seeds that take longest.
    """
    found, missing = {}, []
    for task in tasks:
        name = f"nes_seeds_{task}{suffix}"
        try:
            result = read_result(name, "runs")
        except NotMeasured as error:
            missing.append(str(error))
            continue
        requested = result["command"].partition("--seeds ")[2].partition(" --")[0]
        if parse_seeds(requested) == [run["seed"] for run in result["runs"]]:
            found[task] = result
        else:
            missing.append(f"some seeds of `benchmarks/results/{name}.json`")
    if not found:
        raise NotMeasured(", ".join(missing))
    return found


def _seeds_row(task: str, runs: Sequence[dict[str, Any]]) -> list[str]:
    confirmed = [run["seconds_to_se"] for run in runs if run["confirmed"]]
    utilisation = statistics.median(run["core_utilisation"] for run in runs)
    ranges = (
        median_and_range([run[name] for run in runs])
        for name in ("seconds", "core_seconds", "generations", "final_train_steps")
    )
    return [
        task,
        number_and_interval(sum(run["solved"] for run in runs), len(runs)),
        f"{len(confirmed)} of {len(runs)}",
        median_and_range(confirmed) if confirmed else "-",
        *ranges,
        median_and_range([run["real_env_steps"] / 1e3 for run in runs]),
        f"{utilisation:.0%}",
    ]


def _agent_rows(task: str, runs: Sequence[dict[str, Any]]) -> list[list[str]]:
    rows = []
    by_se = [run["taught"] for run in runs if "taught" in run]
    for kind in dict.fromkeys(kind for results in by_se for kind in results):
        results = [results[kind] for results in by_se if kind in results]
        means = [statistics.mean(on_se["scores"]) for on_se in results]
        target = TARGETS[task][kind.split()[0].rstrip(",")]
        steps = [step for on_se in results for step in on_se.get("train_steps", ())]
        numbers = sorted({len(on_se["scores"]) for on_se in results})
        rows.append(
            [
                task,
                kind,
                str(len(results)),
                " or ".join(map(str, numbers)),
                mean_and_range(means),
                f"{sum(mean >= target for mean in means)} (target {target:g})",
                f"{statistics.mean(steps):.0f}" if steps else "-",
            ]
        )
    return rows


TABLES: dict[str, Callable[[], str]] = {
    "nes-seeds": seeds,
    "nes-taught": partial(taught, "_exogenous"),
}
