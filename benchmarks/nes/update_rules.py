"""NES from random starts, by every update rule and score transform: starts, SEs, agents,
population and generations are the same; step sizes are those that the presets have for a rule.
How many seeds solve the task, when, whether they stay there, and what fresh agents learn on the
best SE.

    python -m benchmarks.nes.update_rules CartPole-v0 --seeds 0 1 2 3 4 5

One process a core, without Ray. `results/update_rules_TASK.json` keeps what earlier calls found;
a call runs only what is missing there.
"""

import argparse
import os
import statistics
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
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

#: Steps of an episode on an SE, as a share of the task's. On Acrobot half of the default: on random
#: SEs there, episodes do not end by themselves.
STEP_LIMIT_SHARES = {"CartPole-v0": 0.5, "Acrobot-v1": 0.25}

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
    return replace(
        base,
        se=replace(base.se, step_limit_share=STEP_LIMIT_SHARES[task_id]),
        nes=replace(base.nes, **PLAIN | rules(task_id)[rule]),
    )


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
    task_id: str, rule: str, seed: int, psi: NDArray[np.float32], generations: int
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
        for number in range(AGENTS)
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


def command(task_id: str, rule: str, seeds: Sequence[int], generations: int) -> str:
    """What measures these runs."""
    return (
        f"python -m benchmarks.nes.update_rules {task_id} --rules '{rule}' "
        f"--seeds {' '.join(map(str, seeds))} --generations {generations}"
    )


class Found:
    """Runs by rule and seed, written to `results/update_rules_TASK.json` as they come.

    Those that an earlier call found with the same step sizes and as many generations on the same
    machine are kept; what all rules share is not compared: where that changes, delete the file.
    """

    def __init__(self, task_id: str, generations: int) -> None:
        self.task_id, self.generations = task_id, generations
        self._name = f"update_rules_{task_id}"
        try:
            self._rules: dict[str, dict[str, Any]] = read_result(self._name)["rules"]
        except NotMeasured:
            self._rules = {}

    def _about(self, rule: str) -> dict[str, Any]:
        return {
            "machine": machine(),
            "options": rules(self.task_id)[rule],
            "generations": self.generations,
        }

    def runs(self, rule: str) -> dict[int, dict[str, Any]]:
        """Those that need no further run, by seed."""
        found, about = self._rules.get(rule, {}), self._about(rule)
        if any(found.get(field) != value for field, value in about.items()):
            return {}
        return {run["seed"]: run for run in found["runs"]}

    def add(self, rule: str, run: dict[str, Any]) -> None:
        """One run more."""
        runs = self.runs(rule) | {run["seed"]: run}
        self._rules[rule] = self._about(rule) | {
            "command": command(self.task_id, rule, sorted(runs), self.generations),
            "runs": [runs[seed] for seed in sorted(runs)],
        }
        ordered = {name: self._rules[name] for name in rules(self.task_id) if name in self._rules}
        write_result(self._name, "python -m benchmarks.nes.update_rules", {"rules": ordered})


def main() -> None:
    """Run what `results/update_rules_TASK.json` lacks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--rules", nargs="+", help="default: all")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--generations", type=int, default=15)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at a time")
    options = parser.parse_args()
    task, known = options.task, list(rules(options.task))
    names = options.rules or known
    if unknown := set(names) - set(known):
        parser.error(f"unknown rules {sorted(unknown)}: known are {known}")
    found = Found(task, options.generations)
    missing = [
        (seed, rule) for seed in options.seeds for rule in names if seed not in found.runs(rule)
    ]
    with ProcessPoolExecutor(options.jobs) as jobs:
        starts = {
            seed: jobs.submit(random_start, task, seed, CANDIDATES)
            for seed in {seed for seed, _ in missing}
        }
        running = {
            jobs.submit(run, task, rule, seed, starts[seed].result(), options.generations): rule
            for seed, rule in missing
        }
        for done, ended in enumerate(as_completed(running), 1):
            found.add(running[ended], ended.result())
            print(f"{done} of {len(missing)}: {running[ended]}, {ended.result()}", flush=True)


if __name__ == "__main__":
    main()
