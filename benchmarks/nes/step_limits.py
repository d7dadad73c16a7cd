"""What shorter episodes on an SE save, and what they cost: train steps and test returns of
small varied agents at several step limits, on the best SEs of `benchmarks.nes.study`.

    python -m benchmarks.nes.step_limits CartPole-v0 --seeds 0 1 2 3 4 --home FOLDER

Nothing but the step limit differs from one point to the next: SE and agents are the same.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import write_result
from benchmarks.nes.study import AGENTS, Study
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import load_preset
from bilevel.kernels.blas import one_blas_thread
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from cluster.final import BEST_FILE
from search_spaces import draw_agent

#: Shares of the real task's step limit.
SHARES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)


def measured(task_id: str, file: Path, kind: str, share: float, agents: int) -> dict[str, float]:
    """What so many agents of a kind learn on the SE in a file, its step limit replaced."""
    task, se = get_task(task_id), load_se(file)
    architecture = replace(se.architecture, step_limit_share=share)
    kinds = load_preset("default", task_id, agents=(kind,)).agents
    with one_blas_thread():
        outcomes = [
            train_and_test(task, (architecture, se.psi), draw_agent(kinds, "small", seed), seed)
            for seed in range(agents)
        ]
    scores = np.array([np.mean(outcome.test_returns) for outcome in outcomes])
    return {
        "score_mean": round(float(scores.mean()), 1),
        "solved_fraction": round(float((scores >= task.solved_reward).mean()), 2),
        "train_steps_mean": round(float(np.mean([o.train_steps for o in outcomes]))),
    }


def main() -> None:
    """Measure all, write `results/step_limits_TASK.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--agents", type=int, default=16, help="of each kind, on each SE")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="SEs at a time")
    parser.add_argument("--home", type=Path, required=True, help="of benchmarks.nes.study")
    options = parser.parse_args()
    study = Study(options.task, 0, options.home)
    files = [study.folder("defaults", seed) / BEST_FILE for seed in options.seeds]
    points: dict[str, list[dict[str, Any]]] = {}
    with ProcessPoolExecutor(options.jobs) as pool:
        for kind in AGENTS:
            points[kind] = []
            for share in SHARES:
                runs = [
                    pool.submit(measured, options.task, file, kind, share, options.agents)
                    for file in files
                ]
                points[kind].append({"share": share, "ses": [run.result() for run in runs]})
                print(kind, points[kind][-1], flush=True)
    command = (
        f"python -m benchmarks.nes.step_limits {options.task} "
        f"--seeds {' '.join(map(str, options.seeds))} --agents {options.agents} --home FOLDER"
    )
    values = {"agents": options.agents, "points": points}
    print(f"written to {write_result(f'step_limits_{options.task}', command, values)}")


if __name__ == "__main__":
    main()
