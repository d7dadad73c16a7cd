"""NES from random starts, by every update rule and score transform: starts, SEs, agents,
population and generations are the same; step sizes are those that the presets have for a rule.
How many seeds solve the task, when, whether they stay there, and what fresh agents learn on the
best SE.

    python -m benchmarks.nes.update_rules CartPole-v0 --seeds 0 1 2 3 4 5

One process a core, without Ray. `results/update_rules_TASK.json` keeps what earlier calls found.
"""

import argparse
import os
import statistics
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import NotMeasured, machine, read_result, write_result
from bilevel.evaluation import EvaluationRequest, EvaluationResult, evaluate
from bilevel.hyperparameters import Hyperparameters, load_preset
from bilevel.hyperparameters.definitions import SCORE_TRANSFORMS
from bilevel.nes import NES, NESState
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task, get_task
from search_spaces import draw_agent

#: What a run has, whatever its rule: small SEs and the small varied agents of `paired`, the
#: paper's fitness, and nothing that adapts or remembers.
PLAIN: dict[str, Any] = {
    "start": "random",
    "population_size": 16,
    "step_price": 0.0,
    "retention": 0.0,
    "momentum": 0.0,
    "fallback": 0.0,
}

#: Random SEs of which the start is chosen, the same for all rules.
CANDIDATES = 64

#: Fresh agents on the best SE.
AGENTS = 20

#: Momentum makes this many steps of one.
_MOMENTUM = 0.8
_STEPS_OF_ONE = 1 / (1 - _MOMENTUM)


def rules(task_id: str) -> dict[str, dict[str, Any]]:
    """Changes of `nes` by name; step sizes and sigmas are the presets' for the rule, those of
    `paper` and `authors` the paper's Table 1."""
    found: dict[str, dict[str, Any]] = {}
    paired = load_preset("tuned", task_id).nes
    kept = {name: getattr(paired, name) for name in ("retention", "momentum", "fallback")}
    sizes = {"step_size": paired.step_size, "std_dev": paired.std_dev}
    found["paired, adapted"] = {"update": "paired", **sizes, **kept}
    sizes["step_size"] *= _STEPS_OF_ONE
    found["paired"] = {"update": "paired", **sizes}
    for update in ("antithetic", "paper", "authors"):
        nes = load_preset("tuned", task_id, update).nes
        sizes = {"step_size": nes.step_size, "std_dev": nes.std_dev}
        for transform in SCORE_TRANSFORMS if update != "antithetic" else ("",):
            scores = {"score_transform": transform} if transform else {}
            found[f"{update}, {transform}".removesuffix(", ")] = {
                "update": update,
                **sizes,
                **scores,
            }
    return found


def hyperparameters(task_id: str, rule: str) -> Hyperparameters:
    """Of a run with this rule."""
    base = load_preset("tuned", task_id)
    return replace(base, nes=replace(base.nes, **PLAIN | rules(task_id)[rule]))


def _evaluated(
    task: Task,
    architecture: Architecture,
    psi: NDArray[np.float32] | None,
    requests: Sequence[EvaluationRequest],
) -> list[EvaluationResult]:
    return [evaluate(task, architecture, psi, request) for request in requests]


def random_start(task_id: str, seed: int, candidates: int) -> NDArray[np.float32]:
    """psi (P,): the best of so many random SEs."""
    hp = hyperparameters(task_id, "paired")
    hp = replace(hp, nes=replace(hp.nes, start_candidates=candidates))
    nes = NES(get_task(task_id), hp, seed, draw_agent)
    return nes.start(partial(_evaluated, nes.task, nes.architecture)).psi


def run(
    task_id: str,
    rule: str,
    seed: int,
    psi: NDArray[np.float32],
    generations: int,
    agents: int = AGENTS,
) -> dict[str, Any]:
    """What comes of a run from `psi` in so many generations."""
    hp = hyperparameters(task_id, rule)
    nes = NES(get_task(task_id), hp, seed, draw_agent)
    state, began = NESState.of(psi), time.perf_counter()
    while state.generation < generations:
        started = time.perf_counter()
        results = _evaluated(nes.task, nes.architecture, state.psi, nes.ask(state))
        state = nes.tell(state, results, time.perf_counter() - started, time.time())
    minutes = (time.perf_counter() - began) / 60
    solved = [record.score_mean >= nes.task.solved_reward for record in state.records]
    first = solved.index(True) if any(solved) else None
    tests = [
        EvaluationRequest(number, number, draw_agent(hp.agents, hp.vary_agent, number))
        for number in range(agents)
    ]
    fresh = _evaluated(nes.task, nes.architecture, state.finalists[0].psi, tests)
    return {
        "seed": seed,
        "first_solved_generation": first,
        "solved_since": None if first is None else round(statistics.mean(solved[first:]), 2),
        "solved_at_the_end": solved[-1],
        "minutes": round(minutes, 2),
        "best": {
            "score_mean": round(float(np.mean([result.score for result in fresh])), 1),
            "train_steps_mean": round(statistics.mean(r.train_steps for r in fresh)),
        },
        "score_curve": [round(record.score_mean, 1) for record in state.records],
    }


def of_seed(
    task_id: str, names: Sequence[str], seed: int, generations: int
) -> dict[str, dict[str, Any]]:
    """A run of each rule from one start."""
    psi = random_start(task_id, seed, CANDIDATES)
    found = {}
    for name in names:
        found[name] = run(task_id, name, seed, psi, generations)
        print(seed, name, found[name], flush=True)
    return found


def main() -> None:
    """Run all, write `results/update_rules_TASK.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--rules", nargs="+", help="default: all")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--generations", type=int, default=15)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="seeds at a time")
    options = parser.parse_args()
    known = rules(options.task)
    names = options.rules or list(known)
    if unknown := set(names) - set(known):
        parser.error(f"unknown rules {sorted(unknown)}: known are {list(known)}")
    with ProcessPoolExecutor(options.jobs) as jobs:
        waiting = [
            jobs.submit(of_seed, options.task, names, seed, options.generations)
            for seed in options.seeds
        ]
        by_seed = [job.result() for job in waiting]
    name, seeds = f"update_rules_{options.task}", " ".join(map(str, options.seeds))
    try:
        found = read_result(name)["rules"]
    except NotMeasured:
        found = {}
    for rule in names:
        found[rule] = {
            "machine": machine(),
            "command": f"python -m benchmarks.nes.update_rules {options.task} --rules '{rule}' "
            f"--seeds {seeds} --generations {options.generations}",
            "options": known[rule],
            "generations": options.generations,
            "runs": [runs[rule] for runs in by_seed],
        }
    ordered = {rule: found[rule] for rule in known if rule in found}
    path = write_result(name, "python -m benchmarks.nes.update_rules", {"rules": ordered})
    print(f"written to {path}")


if __name__ == "__main__":
    main()
