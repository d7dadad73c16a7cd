"""What it costs to give every member an agent of its own: time and train steps of an evaluation,
its agent fixed, varied, or of one of three kinds, on the best SEs of `benchmarks.nes.study` with
mixed agents.

    python -m benchmarks.nes.variation CartPole-v0 --seeds 0 1 2 3 --home FOLDER

The ways take turns on one core, with other agents every time; times are the processor's.
"""

import argparse
import statistics
import time
from pathlib import Path
from typing import Any

from benchmarks.machine import spread, write_result
from benchmarks.nes.study import AGENTS, Study
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import AgentHyperparameters, load_preset
from bilevel.kernels.blas import one_blas_thread
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from cluster.final import BEST_FILE
from search_spaces import draw_agent

#: Kinds of agents, and how `--vary-hp` varies them.
WAYS: dict[str, tuple[tuple[str, ...], str]] = {
    "fixed agents": (("ddqn",), "no"),
    "small varied agents": (("ddqn",), "small"),
    "fully varied agents": (("ddqn",), "all"),
    "mixed agents, small and varied": (AGENTS, "small"),
}


def drawn(task_id: str, way: str, seeds: range) -> list[AgentHyperparameters]:
    """The agents that members get, one a seed."""
    kinds, vary = WAYS[way]
    agents = load_preset("default", task_id, agents=kinds).agents
    return [draw_agent(agents, vary, seed) for seed in seeds]


def cost(task_id: str, file: Path, way: str, seeds: range) -> dict[str, float]:
    """Of one evaluation, the mean over the agents: processor seconds, and train steps."""
    task, se = get_task(task_id), load_se(file)
    started = time.process_time()
    outcomes = [
        train_and_test(task, (se.architecture, se.psi), agent, seed)
        for agent, seed in zip(drawn(task_id, way, seeds), seeds, strict=True)
    ]
    seconds = (time.process_time() - started) / len(seeds)
    return {
        "seconds": seconds,
        "train_steps": statistics.mean(outcome.train_steps for outcome in outcomes),
    }


def beside_fixed(repeats: list[dict[str, dict[str, float]]], way: str) -> dict[str, Any]:
    """Ratios to fixed agents, repeat by repeat."""
    pairs = [(repeat[way], repeat["fixed agents"]) for repeat in repeats]
    return {
        field: spread([ours[field] / fixed[field] for ours, fixed in pairs])
        for field in ("seconds", "train_steps")
    }


def main() -> None:
    """Measure all, write `results/variation_TASK.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3])
    parser.add_argument("--agents", type=int, default=16, help="of each way, on each SE")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--home", type=Path, required=True, help="of benchmarks.nes.study")
    options = parser.parse_args()
    study = Study(options.task, 0, options.home)
    files = [study.folder("mixed agents", seed) / BEST_FILE for seed in options.seeds]
    repeats: list[dict[str, dict[str, float]]] = []
    with one_blas_thread():
        for way in WAYS:  # compiles
            cost(options.task, files[0], way, range(len(AGENTS)))
        for repeat in range(options.repeats):
            seeds = range(repeat * options.agents, (repeat + 1) * options.agents)
            found = {}
            for way in WAYS:
                of_ses = [cost(options.task, file, way, seeds) for file in files]
                found[way] = {
                    field: statistics.mean(one[field] for one in of_ses) for field in of_ses[0]
                }
            repeats.append(found)
            print(repeat, found, flush=True)
    command = (
        f"python -m benchmarks.nes.variation {options.task} "
        f"--seeds {' '.join(map(str, options.seeds))} --agents {options.agents} "
        f"--repeats {options.repeats} --home FOLDER"
    )
    values = {
        "ses": len(files),
        "agents": options.agents,
        "repeats": options.repeats,
        "ways": {way: beside_fixed(repeats, way) for way in WAYS},
    }
    print(f"written to {write_result(f'variation_{options.task}', command, values)}")


if __name__ == "__main__":
    main()
