"""NES runs over seeds: how many solve the task, in what time, and how other agents do on their SEs.

    python -m benchmarks.nes.seeds CartPole-v0 --seeds 0-2 --agents 6 --sb3 3 --home FOLDER

Each seed is one `bilevel nes TASK --seed SEED` on all cores; the seconds are those of the whole
command. On the best SEs of the first `--taught` seeds, fresh agents of every kind are trained with
hyperparameters from the paper's full ranges, and with `--sb3` also agents of Stable-Baselines3.
Results are written seed by seed to `results/nes_seeds_TASK.json`; the same command resumes.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import Any

import gymnasium
import numpy as np

from benchmarks.agents import sb3
from benchmarks.arguments import format_seeds, known_task, parse_seeds
from benchmarks.machine import require_as_many, resumed_runs, write_result
from bilevel.agents.variation import draw_agent
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import default_agents
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import load_se
from cluster.nes.run import STATE_FILE, NESRun
from cluster.storage.run_folder import BEST_FILE, finals

#: Kinds of agents that are trained on an SE, and how each is drawn from the paper's ranges.
AGENTS = {
    "ddqn": ("ddqn", "all"),
    "ddqn, narrowed": ("ddqn", "narrowed"),
    "dueling-ddqn": ("dueling-ddqn", "all"),
    "td3": ("td3", "all"),
}

#: Agents of Stable-Baselines3: their kind, and for how many steps they are trained on an SE.
OF_SB3 = {
    f"sb3 {kind}, {steps:,} steps": (kind, steps) for kind in sb3.KINDS for steps in sb3.STEPS
}


def run_seed(
    task: str,
    seed: int,
    recipe: str,
    folder: Path,
    changes: Sequence[str] = (),
    generations: int | None = None,
) -> dict[str, Any]:
    """Run NES with one seed, with these changes of the recipe (FIELD=VALUE) and for at most so many
    generations (None: the recipe's); return its results."""
    home = folder.parent.parent
    command = [str(Path(sys.executable).with_name("bilevel")), "nes", task, "--seed", str(seed)]
    command += ["--recipe", recipe, "--home", str(home), "--name", folder.name]
    for change in changes:
        command += ["--set", change]
    if generations is not None:
        command += ["--generations", str(generations)]
    rmtree(folder, ignore_errors=True)  # a run that was interrupted would be too fast
    began = time.time()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    seconds = time.time() - began
    # The state is last written when the SE is confirmed, or the generations are over.
    to_se = (folder / STATE_FILE).stat().st_mtime - began
    run = NESRun.read(folder)
    state, final = run.load(), finals(folder)[-1].metrics
    assert state is not None
    records = state.records
    solved = [r.generation for r in records if r.score_mean >= run.task.solved_reward]
    return {
        "seed": seed,
        "seconds_to_se": round(to_se, 1),
        "seconds": round(seconds, 1),
        "confirmed": state.confirmed,
        "core_seconds": round(state.cost, 1),
        "generations": len(records),
        "attempts": state.attempt + 1,
        "first_solved_generation": solved[0] if solved else None,
        "final_score": round(final["final_score_mean"], 1),
        "final_train_steps": round(final["final_train_steps_mean"]),
        "solved": bool(final["final_score_mean"] >= run.task.solved_reward),
        "real_env_steps": load_se(folder / BEST_FILE).info["real_env_steps"],
        "core_utilisation": round(float(np.median([r.core_utilisation for r in records])), 3),
    }


def teach(path: Path, kind: str, number: int) -> tuple[float, int]:
    """Score and train steps of a fresh agent, drawn from the paper's full ranges."""
    se, (name, vary) = load_se(path), AGENTS[kind]
    base = default_agents([name])
    agent = draw_agent(base, vary, derive(number, Purpose.AGENT))
    outcome = train_and_test(se.task(), se.se, agent, derive(number, Purpose.FINAL))
    return outcome.score, outcome.train_steps


def teach_sb3(path: Path, kind: str, steps: int, seed: int) -> float:
    """Mean return on the real task of a Stable-Baselines3 agent that was trained on the SE for so
    many steps."""
    se = partial(gymnasium.make, "bilevel/SyntheticEnv-v0", path=path)
    agent = sb3.trained(kind, se, steps, seed)
    return sb3.score(agent, load_se(path).task().make(), seed)


def taught(path: Path, agents: int, others: int, known: Mapping[str, Any]) -> dict[str, Any]:
    """Results of agents trained on the SE, by kind of agent: those that are `known`, and the
    others' measured now."""
    found = dict(known)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        ours = {
            kind: [pool.submit(teach, path, kind, number) for number in range(agents)]
            for kind in AGENTS
            if kind not in known
        }
        theirs = {
            name: [pool.submit(teach_sb3, path, kind, steps, seed) for seed in range(others)]
            for name, (kind, steps) in OF_SB3.items()
            if others and name not in known
        }
        for kind, jobs in ours.items():
            results = [job.result() for job in jobs]
            found[kind] = {
                "scores": [round(score, 1) for score, _ in results],
                "train_steps": [steps for _, steps in results],
            }
        for name, waiting in theirs.items():
            found[name] = {"scores": [round(job.result(), 1) for job in waiting]}
    return {kind: found[kind] for kind in (*AGENTS, *OF_SB3) if kind in found}


def main() -> None:
    """Measure the missing results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", type=known_task)
    parser.add_argument("--seeds", type=parse_seeds, required=True, help="such as 0-4,9")
    parser.add_argument("--recipe", default="default")
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="FIELD=VALUE", help="changes of the recipe"
    )
    parser.add_argument(
        "--taught", type=int, default=5, help="number of seeds on whose SEs agents are trained"
    )
    parser.add_argument("--agents", type=int, default=6, help="fresh agents of each kind per SE")
    parser.add_argument(
        "--sb3", type=int, default=0, help="Stable-Baselines3 agents of each kind per SE"
    )
    parser.add_argument("--generations", type=int, help="at most; default: the recipe's")
    parser.add_argument("--home", type=Path, required=True)
    options = parser.parse_args()
    # The name of a recipe file may end with that of the task.
    recipe = Path(options.recipe).name.removesuffix(".toml").removesuffix(f"-{options.task}")
    label = "-".join([recipe, *(change.replace("=", "-") for change in options.set)])
    name = f"nes_seeds_{options.task}" + (f"_{label}" if label != "default" else "")
    more = f"--set {' '.join(options.set)} " if options.set else ""
    more += f"--generations {options.generations} " if options.generations else ""
    command = (
        f"python -m benchmarks.nes.seeds {options.task} --recipe {options.recipe} --seeds "
        f"{format_seeds(options.seeds)} --taught {options.taught} --agents "
        f"{options.agents} --sb3 {options.sb3} {more}--home FOLDER"
    )
    before = resumed_runs(name, command, ("seeds", "taught"), options.seeds)
    runs = {run["seed"]: run for run in before}
    begun = [runs.get(seed, {}) for seed in options.seeds]
    measured = max((place for place, run in enumerate(begun, 1) if "taught" in run), default=0)
    require_as_many(name, "--taught", measured, options.taught)

    def keep(run: dict[str, Any]) -> None:
        runs[run["seed"]] = run
        write_result(name, command, {"runs": [runs[seed] for seed in sorted(runs)]}, resumed=True)
        print(run, flush=True)

    def folder(seed: int) -> Path:
        return Path(options.home, options.task, f"{label}-seed{seed}")

    for seed in options.seeds:
        if seed not in runs:
            how = (options.recipe, folder(seed), options.set, options.generations)
            keep(run_seed(options.task, seed, *how))
    for seed in options.seeds[: options.taught]:
        known = runs[seed].get("taught", {})
        lessons = taught(folder(seed) / BEST_FILE, options.agents, options.sb3, known)
        if lessons != known:
            keep({**runs[seed], "taught": lessons})


if __name__ == "__main__":
    main()
