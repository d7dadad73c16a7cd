"""How well the estimated cost of evaluations (`bilevel.cost`) agrees with measured time.

    python -m benchmarks.speed.cost

Agents of every kind are drawn from the paper's ranges as NES draws them, trained on an SE of the
zoo and tested, on one core.
"""

import time
from typing import Any

from benchmarks.machine import spread, write_result
from bilevel.agents.variation import draw_agent
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import load_recipe
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from bilevel.zoo import zoo_file

_REPEATS = 3
_DRAWN = {"small": 20, "narrowed": 20, "all": 4}
_AGENTS = ("ddqn", "dueling-ddqn", "td3")


def measured(task_id: str, kind: str, vary: str, repeat: int) -> tuple[float, float]:
    """Seconds and estimated core seconds of some agents of a kind, and of a repeat of their own."""
    task, base = get_task(task_id), load_recipe("default", task_id, [kind]).agents
    se = load_se(zoo_file(task_id)).se
    numbers = range(repeat * _DRAWN[vary], (repeat + 1) * _DRAWN[vary])
    drawn = [(draw_agent(base, vary, number), number) for number in numbers]
    train_and_test(task, se, *drawn[0])  # loads the kernels
    began = time.perf_counter()
    cost = sum(train_and_test(task, se, agent, number).cost for agent, number in drawn)
    return time.perf_counter() - began, cost


def main() -> None:
    """Measure all kinds of agents."""
    results: dict[str, Any] = {}
    for task in ("CartPole-v0", "Acrobot-v1"):
        for kind in _AGENTS:
            for vary in _DRAWN:
                pairs = [measured(task, kind, vary, repeat) for repeat in range(_REPEATS)]
                ratio = spread([seconds / cost for seconds, cost in pairs])
                mean = sum(seconds for seconds, _ in pairs) / _REPEATS / _DRAWN[vary]
                results[f"{task}, {kind}, {vary}"] = {
                    "ms_an_agent": round(1000 * mean, 1),
                    "measured_over_estimated": ratio,
                }
                print(task, kind, vary, results[f"{task}, {kind}, {vary}"], flush=True)
    print(
        "written to",
        write_result(
            "cost", "python -m benchmarks.speed.cost", {"repeats": _REPEATS, "results": results}
        ),
    )


if __name__ == "__main__":
    main()
