"""The start of NES: random search alone, and with crossover, at about as many evaluations.

    python -m benchmarks.nes_starts CartPole-v0 --seeds 3

Each start is scored with fresh agents that nothing was chosen by.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.machine import write_result
from benchmarks.scaling.evaluations import Processes, processes
from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import NESHyperparameters, load_preset
from bilevel.nes import NES
from bilevel.tasks import get_task
from search_spaces import draw_agent

#: Fresh agents on each start.
AGENTS = 32


def searches(hp: NESHyperparameters) -> dict[str, NESHyperparameters]:
    """The defaults, and random search alone with twice the candidates, which takes as many
    evaluations and a few more."""
    alone = replace(hp, start_candidates=2 * hp.start_candidates, start_crossovers=0)
    return {"with crossover": hp, "random search alone": alone}


def measured(nes: NES, workers: Processes) -> dict[str, Any]:
    """One search, and the score of what it found."""
    evaluations = 0

    def evaluate(requests: Sequence[EvaluationRequest]) -> list[EvaluationResult]:
        nonlocal evaluations
        evaluations += len(requests)
        return workers.run(nes.task, nes.architecture, None, requests)

    psi = nes.start(evaluate).psi
    fresh = [
        EvaluationRequest(i, int(seed), draw_agent(nes.hp.agents, nes.hp.vary_agent, int(seed)))
        for i, seed in enumerate(np.random.SeedSequence([nes.seed, AGENTS]).generate_state(AGENTS))
    ]
    results = workers.run(nes.task, nes.architecture, psi, fresh)
    return {
        "seed": nes.seed,
        "evaluations": evaluations,
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
