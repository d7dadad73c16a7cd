r"""`bilevel bohb` over seeds, by BOHB and by other methods in the same time: how good the SE is
that a study hands over, and what it proposed on the way.

    python -m benchmarks.search.study CartPole-v0 --seeds 0 1 2 3 4 --time-budgets 5m 4m \
        --home FOLDER

Studies are ordinary ones of the `local` profile, one at a time on all cores; those of one seed
begin at the same fitted start. Each is called once a time budget, and goes on where it was. Started
again, this goes on with what is missing.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import write_result
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import Hyperparameters, load_preset
from bilevel.nes import fitness
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from cluster.bohb.journal import ConfigLine, Journal
from cluster.bohb.study import Study, configuration_name
from cluster.final import BEST_FILE
from cluster.profiles import METHODS
from cluster.run_folder import Begun, finals
from search_spaces import draw_agent


@dataclass(frozen=True)
class Comparison:
    """Studies of one task under one home."""

    task: str
    time_budgets: Sequence[str]
    home: Path

    def folder(self, method: str, seed: int) -> Path:
        """Of a study."""
        return self.home / self.task / f"{method}-{seed}"

    def run(self, method: str, seed: int) -> None:
        """A study as a user starts it, and goes on with it. One whose first call did not come to
        its end is begun anew: it would have more time than the others."""
        folder = self.folder(method, seed)
        done = len(finals(folder))
        if not done:
            shutil.rmtree(folder, ignore_errors=True)
        script = Path(sys.executable).with_name("bilevel")
        options = ["--method", method, "--seed", str(seed), "--study", folder.name]
        options += ["--home", str(self.home)]
        for time_budget in self.time_budgets[done:]:
            subprocess.run(
                [script, "bohb", self.task, *options, "--time-budget", time_budget], check=True
            )

    def row(self, method: str, seed: int, agents: int, varied: int) -> dict[str, Any]:
        """What came of a study, and what so many agents of its own, and so many with
        hyperparameters from the whole of the paper's ranges, learn on its best SE."""
        folder = self.folder(method, seed)
        study, journal = Study.read(folder), Journal(folder)
        own = Hyperparameters.from_dict(load_se(folder / BEST_FILE).info["hyperparameters"])
        default = load_preset("tuned", self.task, agents=study.agents)
        return {
            "method": method,
            "seed": seed,
            "budgets": list(study.schedule.budgets),
            "configurations": [configuration(study, line) for line in journal.configs],
            "results": [
                {
                    "configuration": configuration_name(line.id),
                    "budget": line.budget,
                    "objective": None if line.objective is None else round(line.objective, 2),
                    "minutes": round(minutes_until(line.finished, folder, journal), 3),
                }
                for line in journal.results
            ],
            "own": learned(self.task, folder / BEST_FILE, own, own.vary_agent, agents),
            "varied": learned(self.task, folder / BEST_FILE, default, "all", varied),
        }


def configuration(study: Study, line: ConfigLine) -> dict[str, Any]:
    """What was proposed, and how the generations went that it ran."""
    state = study.run(line.id, line.configuration).load_if_sound()
    records = () if state is None else state.records
    return {
        "name": configuration_name(line.id),
        "model_based": bool(line.info.get("model_based_pick")),
        "values": {
            name: float(f"{value:.4g}") if isinstance(value, float) else value
            for name, value in line.configuration.items()
        },
        "fitness": [round(record.fitness_mean, 1) for record in records],
        "seconds": [round(record.generation_seconds, 1) for record in records],
    }


def minutes_until(moment: float, folder: Path, journal: Journal) -> float:
    """That a study had run by then: without what lay between the end of a call and the first job
    of the next one."""
    begun, ends = Begun.read(folder).time, [final.time for final in finals(folder)]
    submitted = [line.timestamps["submitted"] for line in journal.results]
    pauses = sum(
        min((time for time in submitted if time > end), default=end) - end
        for end in ends
        if end < moment
    )
    return (moment - begun - pauses) / 60


def learned(
    task_id: str, file: Path, hp: Hyperparameters, vary: str, agents: int
) -> Mapping[str, float]:
    """What so many fresh agents, drawn from `hp`, learn on the SE in a file."""
    task, se = get_task(task_id), load_se(file)
    outcomes = [
        train_and_test(task, (se.architecture, se.psi), draw_agent(hp.agents, vary, seed), seed)
        for seed in range(agents)
    ]
    scores = np.array([np.mean(outcome.test_returns) for outcome in outcomes])
    steps = np.array([outcome.train_steps for outcome in outcomes])
    return {
        "agents": agents,
        "score_mean": round(float(scores.mean()), 2),
        "solved_fraction": round(float((scores >= task.solved_reward).mean()), 2),
        "train_steps_mean": round(float(steps.mean())),
        "fitness_mean": round(float(fitness(task, hp.nes, scores, steps).mean()), 2),
    }


def main() -> None:
    """Run what is missing, write `results/search_TASK.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=["bohb", "random"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--time-budgets", nargs="+", default=["5m", "4m"], help="of the calls")
    parser.add_argument("--agents", type=int, default=64, help="on each best SE")
    parser.add_argument("--varied", type=int, default=20, help="likewise, fully varied")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="SEs tested at a time")
    parser.add_argument("--home", type=Path, required=True)
    options = parser.parse_args()
    comparison = Comparison(options.task, options.time_budgets, options.home)
    studies = [(method, seed) for seed in options.seeds for method in options.methods]
    for method, seed in studies:
        comparison.run(method, seed)
    with ProcessPoolExecutor(options.jobs) as jobs:
        waiting = [
            jobs.submit(comparison.row, method, seed, options.agents, options.varied)
            for method, seed in studies
        ]
        rows = [job.result() for job in waiting]
    command = (
        f"python -m benchmarks.search.study {options.task} --methods {' '.join(options.methods)} "
        f"--seeds {' '.join(map(str, options.seeds))} "
        f"--time-budgets {' '.join(options.time_budgets)} "
        f"--agents {options.agents} --varied {options.varied} --home FOLDER"
    )
    path = write_result(f"search_{options.task}", command, {"studies": rows})
    print(json.dumps(rows, indent=1))
    print(f"written to {path}")


if __name__ == "__main__":
    main()
