"""Measured time of evaluations relative to their estimated cost (`core_seconds`).

    python -m benchmarks.speed.cost

Agents of every kind are drawn from the paper's ranges as NES draws them, trained on an SE of the
zoo and tested, on one core.
"""

import time

from benchmarks.machine import read_result, spread, write_result
from benchmarks.markdown import format_spread, table
from bilevel.agents.variation import draw_agent
from bilevel.evaluation import train_and_test
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from bilevel.zoo import zoo_file

REPEATS = 3
#: Agents per repeat, by the variation of their hyperparameters.
DRAWN = {"small": 20, "narrowed": 20, "all": 4}
AGENTS = ("ddqn", "dueling-ddqn", "td3")


def measure(task_id: str, kind: str, vary: str, repeat: int) -> tuple[float, float]:
    """Return measured seconds and estimated core seconds of the agents of one repeat."""
    task, base = get_task(task_id), load_recipe("default", task_id, [kind]).agents
    se = load_se(zoo_file(task_id)).se
    numbers = range(repeat * DRAWN[vary], (repeat + 1) * DRAWN[vary])
    drawn = [(draw_agent(base, vary, number), number) for number in numbers]
    train_and_test(task, se, *drawn[0])  # loads the kernels
    started = time.perf_counter()
    cost = sum(train_and_test(task, se, agent, number).cost for agent, number in drawn)
    return time.perf_counter() - started, cost


def cost() -> str:
    """Return the table."""
    result = read_result("cost")
    head = "agents", "milliseconds per agent", "measured time over core seconds"
    rows = [
        (label, f"{case['ms_an_agent']:.1f}", format_spread(case["measured_over_estimated"], ".2f"))
        for label, case in result["results"].items()
    ]
    return table(head, rows, result)


def main() -> None:
    """Measure all kinds of agents and write `results/cost.json`."""
    results = {}
    for task in ("CartPole-v0", "Acrobot-v1"):
        for kind in AGENTS:
            for vary, number in DRAWN.items():
                pairs = [measure(task, kind, vary, repeat) for repeat in range(REPEATS)]
                mean = sum(seconds for seconds, _ in pairs) / REPEATS / number
                label = f"{task}, {kind}, {vary}"
                results[label] = {
                    "ms_an_agent": round(1000 * mean, 1),
                    "measured_over_estimated": spread([seconds / cost for seconds, cost in pairs]),
                }
                print(label, results[label], flush=True)
    values = {"repeats": REPEATS, "results": results}
    write_result("cost", "python -m benchmarks.speed.cost", values)


if __name__ == "__main__":
    main()
