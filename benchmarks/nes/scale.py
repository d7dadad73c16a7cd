"""NES with the scale of observations measured over more and fewer random steps.

    python -m benchmarks.nes.scale CartPole-v0 --seeds 650-661,690-697

Each seed runs NES by the recipe `default` in one process, once with each number of steps, as many
runs at a time as there are cores. Results are written one by one to `results/nes_scale_TASK.json`;
the same command resumes.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any

import numpy as np

import bilevel.tasks.task
from benchmarks.arguments import format_seeds, known_task, parse_seeds
from benchmarks.machine import resumed_runs, write_result
from benchmarks.nes.run import run_nes
from bilevel.hyperparameters import load_recipe
from bilevel.seeds import Purpose, derive
from bilevel.tasks import get_task

#: Numbers of random steps: a hundredth of those that a compiled task has, a tenth, and as many.
STEPS = 1_000, 10_000, 100_000


def measured(task_id: str, steps: int, seed: int) -> dict[str, Any]:
    """Run NES with the scale measured over so many steps, which is told beside it."""
    bilevel.tasks.task.SCALE_STEPS = bilevel.tasks.task.GYMNASIUM_SCALE_STEPS = steps
    task = get_task(task_id)
    scale = task.observation_scale(derive(seed, Purpose.OBSERVATIONS))
    of_observations = {
        "mean": np.round(scale.mean.astype(float), 5).tolist(),
        "deviation": np.round(scale.deviation.astype(float), 5).tolist(),
    }
    return {"steps": steps, **of_observations, **run_nes(task, load_recipe("default", task), seed)}


def main() -> None:
    """Measure the missing runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", type=known_task)
    parser.add_argument("--seeds", type=parse_seeds, required=True, help="such as 0-4,9")
    options = parser.parse_args()
    name, seeds = f"nes_scale_{options.task}", options.seeds
    command = f"python -m benchmarks.nes.scale {options.task} --seeds {format_seeds(seeds)}"
    before = resumed_runs(name, command, ("seeds",), seeds)
    runs = {(run["steps"], run["seed"]): run for run in before}
    missing = [(steps, seed) for seed in seeds for steps in STEPS if (steps, seed) not in runs]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        for done in as_completed(pool.submit(measured, options.task, *one) for one in missing):
            run = done.result()
            runs[run["steps"], run["seed"]] = run
            write_result(name, command, {"runs": [runs[key] for key in sorted(runs)]}, resumed=True)
            print(run, flush=True)


if __name__ == "__main__":
    main()
