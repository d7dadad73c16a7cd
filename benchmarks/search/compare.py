"""BOHB, Hyperband and random search at equal core time, by the recipes that they find.

    python -m benchmarks.search.compare CartPole-v0 --seeds 0-5 --home FOLDER

Each search is one `bilevel bohb TASK --method METHOD --seed SEED --space SPACE`, of so many core
seconds and a third as many for its validation. Its recipe then runs NES with fresh seeds, the same
for all recipes, until an SE is confirmed or the generations are over; ten fresh agents of the
paper's full ranges score the SE. The recipe `default` is measured alike. Results are written one by
one to `results/search_TASK.json`; the same command resumes.
"""

import argparse
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import NotMeasured, read_result, write_result
from benchmarks.seeds import format_seeds, parse_seeds
from bilevel.agents.variation import draw_agent
from bilevel.evaluation import evaluate, train_and_test
from bilevel.hyperparameters import load_recipe
from bilevel.nes import NES
from bilevel.nes.confirmation import FINAL_AGENTS
from bilevel.seeds import Purpose, derive
from bilevel.tasks import get_task
from cluster.bohb.brackets import Schedule, core_seconds_to_run
from cluster.bohb.journal import Journal
from cluster.bohb.profiles import METHODS, get_profile
from cluster.bohb.study import RECIPE_FILE
from cluster.bohb.summary import StudySummary

#: The space `core` without the SE's step limit and spread. (docs/tuning.md tells what a search of
#: the episodes' length exploits; and BOHB's model needs fewer results for six hyperparameters than
#: for eight.)
SPACE = Path(__file__).with_name("core-without-episodes.json")

#: Seed of the first fresh run.
_FRESH = 10_000


def brackets_of(method: str, core_seconds: int) -> tuple[int, Schedule]:
    """Number of brackets that cost so much, and the schedule."""
    size = get_profile("local")
    schedule = Schedule.of(method, size.smallest_budget, size.largest_budget, size.cycle)
    return max(round(core_seconds / core_seconds_to_run(schedule.brackets(1))), 1), schedule


def search(task: str, method: str, seed: int, core_seconds: int, home: Path) -> dict[str, Any]:
    """Run a search; return what it found."""
    brackets, schedule = brackets_of(method, core_seconds)
    folder = home / task / f"{method}-seed{seed}"
    command = [str(Path(sys.executable).with_name("bilevel")), "bohb", task, "--method", method]
    command += ["--seed", str(seed), "--brackets", str(brackets), "--time-budget", "100h"]
    # The recipe is the same for all methods: what they find without it is compared.
    command += ["--prior", "none", "--space", str(SPACE)]
    command += ["--study", folder.name, "--home", str(home)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    rungs = schedule.brackets(brackets)
    summary = StudySummary.of(Journal(folder), rungs)
    assert summary.incumbent is not None
    return {
        "core_seconds": core_seconds_to_run(rungs),
        "results": len(summary.journal.results),
        "proposed_by_model": summary.model_based,
        "incumbent": summary.incumbent.loss,
        "configuration": summary.configuration(summary.incumbent.id),
    }


def fresh_run(task_id: str, recipe: str, number: int) -> dict[str, Any]:
    """Run NES by a recipe with a fresh seed, in this process."""
    task, seed = get_task(task_id), _FRESH + number
    hp = load_recipe(recipe, task_id)
    state = NES(task, hp, seed).run(
        lambda ses, requests: [evaluate(task, ses, r) for r in requests]
    )
    scores = []
    for agent in range(FINAL_AGENTS):
        drawn = draw_agent(hp.agents, "all", derive(seed, Purpose.AGENT, int(Purpose.FINAL), agent))
        trial = derive(seed, Purpose.FINAL, agent)
        scores.append(train_and_test(task, state.best.se, drawn, trial).score)
    return {
        "seed": seed,
        "confirmed": state.confirmed,
        "core_seconds": round(state.cost, 1),
        "generations": state.generation,
        "score": round(float(np.mean(scores)), 1),
        "solved": bool(np.mean(scores) >= task.solved_reward),
    }


def main() -> None:
    """Measure what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--seeds", type=parse_seeds, required=True, help="such as 0-5")
    parser.add_argument(
        "--core-seconds", type=int, default=1890, help="of a search, without validation"
    )
    parser.add_argument("--fresh", type=int, default=10, help="NES runs of each recipe")
    parser.add_argument("--home", type=Path, required=True)
    options = parser.parse_args()
    name = f"search_{options.task}"
    command = (
        f"python -m benchmarks.search.compare {options.task} --seeds "
        f"{format_seeds(options.seeds)} --core-seconds {options.core_seconds} --fresh "
        f"{options.fresh} --home FOLDER"
    )
    try:
        rows: dict[str, Any] = read_result(name)["rows"]
    except NotMeasured:
        rows = {}

    def keep(key: str, row: dict[str, Any]) -> None:
        rows[key] = row
        write_result(name, command, {"rows": rows})
        print(key, row, flush=True)

    def quality(recipe: str) -> list[dict[str, Any]]:
        with ProcessPoolExecutor(os.cpu_count()) as pool:
            run = partial(fresh_run, options.task, recipe)
            return list(pool.map(run, range(options.fresh)))

    if "default" not in rows:
        keep("default", {"fresh": quality("default")})
    for seed in options.seeds:
        for method in METHODS:
            key = f"{method} {seed}"
            row = rows.get(key, {})
            if "search" not in row:
                found = search(options.task, method, seed, options.core_seconds, options.home)
                row = {"method": method, "seed": seed, "search": found}
                keep(key, row)
            if "fresh" not in row:
                recipe = options.home / options.task / f"{method}-seed{seed}" / RECIPE_FILE
                keep(key, {**row, "fresh": quality(str(recipe))})


if __name__ == "__main__":
    main()
