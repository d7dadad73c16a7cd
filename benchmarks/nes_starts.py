"""The start of NES: SEs fitted to the task, and random ones.

    python -m benchmarks.nes_starts CartPole-v0 --seeds 3

Each start is scored with fresh agents that nothing was chosen by.
"""

import argparse
import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.machine import write_result
from benchmarks.scaling.evaluations import Processes, processes
from bilevel.evaluation import EvaluationRequest
from bilevel.hyperparameters import NESHyperparameters, load_preset
from bilevel.nes import NES
from bilevel.tasks import get_task
from search_spaces import draw_agent

#: Fresh agents on each start.
AGENTS = 32


def searches(hp: NESHyperparameters) -> dict[str, NESHyperparameters]:
    """The defaults, one fitted SE that nothing is chosen from, and the best of many random
    ones."""
    return {
        f"best of {hp.start_candidates} fitted": hp,
        "one fitted": replace(hp, start_candidates=1),
        "best of 512 random": replace(hp, start="random", start_candidates=512),
    }


def measured(nes: NES, workers: Processes) -> dict[str, Any]:
    """One search, and the score of what it found."""
    started = time.perf_counter()
    psi = nes.start(partial(workers.run, nes.task, nes.architecture)).psi
    seconds = time.perf_counter() - started
    fresh = [
        EvaluationRequest(i, int(seed), draw_agent(nes.hp.agents, nes.hp.vary_agent, int(seed)))
        for i, seed in enumerate(np.random.SeedSequence([nes.seed, AGENTS]).generate_state(AGENTS))
    ]
    results = workers.run(nes.task, nes.architecture, psi, fresh)
    return {
        "seed": nes.seed,
        "seconds": round(seconds, 1),
        "score_mean": round(float(np.mean([result.score for result in results])), 1),
        "train_steps_mean": round(float(np.mean([result.train_steps for result in results]))),
    }


def main() -> None:
    """Write `results/starts_TASK.json`, anew after every seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    hp = load_preset("tuned", options.task)
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in searches(hp.nes)}
    with processes() as workers:
        for seed in range(options.seeds):
            for name, nes_hp in searches(hp.nes).items():
                nes = NES(get_task(options.task), replace(hp, nes=nes_hp), seed, draw_agent)
                rows[name].append(measured(nes, workers))
                print(name, rows[name][-1], flush=True)
            command = f"python -m benchmarks.nes_starts {options.task} --seeds {seed + 1}"
            write_result(f"starts_{options.task}", command, {"agents": AGENTS, "starts": rows})


if __name__ == "__main__":
    main()
