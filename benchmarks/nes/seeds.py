"""NES runs over seeds, and the scores of other agents trained on their SEs.

    python -m benchmarks.nes.seeds CartPole-v0 --seeds 0-2 --agents 6 --sb3 3 --home FOLDER

Each seed is one `bilevel nes TASK --seed SEED` on all cores, and its time is the command's. For
tasks with discrete actions, fresh agents of every kind, with hyperparameters from the paper's full
ranges, are trained on the best SEs of the first `--taught` seeds; `--sb3` adds agents of
Stable-Baselines3. Results are written seed by seed to `results/nes_seeds_TASK.json`; the same
command resumes.
"""

import argparse
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import Any

import gymnasium
import numpy as np

from benchmarks.agents import sb3
from benchmarks.machine import (
    earlier_result,
    format_seeds,
    known_task,
    parse_seeds,
    write_result,
)
from bilevel.agents.variation import draw_agent
from bilevel.evaluation import train_and_test
from bilevel.recipes import usual_agents
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

#: Agents of Stable-Baselines3: their kind, and their train steps on an SE.
SB3_AGENTS = {
    f"sb3 {kind}, {steps:,} steps": (kind, steps) for kind in sb3.KINDS for steps in sb3.STEPS
}


def run_seed(options: argparse.Namespace, seed: int, folder: Path) -> dict[str, Any]:
    """Run the command `bilevel nes` with one seed; return its results."""
    command = [str(Path(sys.executable).with_name("bilevel")), "nes", options.task]
    command += ["--seed", str(seed), "--recipe", options.recipe]
    command += ["--home", str(options.home), "--name", folder.name]
    if options.solved_reward is not None:
        command += ["--solved-reward", str(options.solved_reward)]
    for change in options.set:
        command += ["--set", change]
    if options.generations is not None:
        command += ["--generations", str(options.generations)]
    rmtree(folder, ignore_errors=True)  # resuming would take less time
    started = time.time()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    seconds = time.time() - started
    # The state is last written when the SE is confirmed, or after the last generation.
    to_se = (folder / STATE_FILE).stat().st_mtime - started
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
        "solved_reward": run.task.solved_reward,
        "solved": bool(final["final_score_mean"] >= run.task.solved_reward),
        "real_env_steps": load_se(folder / BEST_FILE).info["real_env_steps"],
        "core_utilisation": round(float(np.median([r.core_utilisation for r in records])), 3),
    }


def train_agent(path: Path, kind: str, number: int) -> tuple[float, int]:
    """Train a fresh agent on an SE; return its score and train steps."""
    se, (name, vary) = load_se(path), AGENTS[kind]
    task = se.task()
    agents = usual_agents(task, se.se.architecture.one_step, [name])
    agent = draw_agent(agents, vary, derive(number, Purpose.AGENT))
    outcome = train_and_test(task, se.se, agent, derive(number, Purpose.FINAL))
    return outcome.score, outcome.train_steps


def train_sb3_agent(path: Path, kind: str, steps: int, seed: int) -> float:
    """Train a Stable-Baselines3 agent on an SE; return its mean return on the real task."""
    se = partial(gymnasium.make, "bilevel/SyntheticEnv-v0", path=path)
    return sb3.score(sb3.trained(kind, se, steps, seed), load_se(path).task().make(), seed)


def train_agents(path: Path, agents: int, sb3_agents: int, known: dict[str, Any]) -> dict[str, Any]:
    """Return results of agents trained on the SE, by kind; kinds that are `known` are not rerun."""
    results = dict(known)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for kind in AGENTS.keys() - known.keys():
            found = [*pool.map(partial(train_agent, path, kind), range(agents))]
            results[kind] = {
                "scores": [round(score, 1) for score, _ in found],
                "train_steps": [steps for _, steps in found],
            }
        for name in SB3_AGENTS.keys() - known.keys() if sb3_agents else ():
            scores = pool.map(partial(train_sb3_agent, path, *SB3_AGENTS[name]), range(sb3_agents))
            results[name] = {"scores": [round(score, 1) for score in scores]}
    return {kind: results[kind] for kind in (*AGENTS, *SB3_AGENTS) if kind in results}


def parse_options() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", type=known_task)
    parser.add_argument("--seeds", type=parse_seeds, required=True, help="such as 0-4,9")
    parser.add_argument("--recipe", default="default")
    parser.add_argument("--set", nargs="+", default=[], metavar="FIELD=VALUE")
    parser.add_argument("--taught", type=int, default=5, help="seeds on whose SEs agents train")
    parser.add_argument("--agents", type=int, default=6, help="fresh agents of each kind per SE")
    parser.add_argument("--sb3", type=int, default=0, help="SB3 agents of each kind per SE")
    parser.add_argument("--generations", type=int, help="maximum; default: the recipe's")
    parser.add_argument("--solved-reward", type=float, help="default: the task's")
    parser.add_argument("--home", type=Path, required=True)
    return parser.parse_args()


def command_of(options: argparse.Namespace) -> str:
    """Return the command with these options."""
    more = f"--set {' '.join(options.set)} " if options.set else ""
    more += f"--generations {options.generations} " if options.generations else ""
    if options.solved_reward is not None:
        more += f"--solved-reward {options.solved_reward:g} "
    return (
        f"python -m benchmarks.nes.seeds {options.task} --recipe {options.recipe} --seeds "
        f"{format_seeds(options.seeds)} --taught {options.taught} --agents "
        f"{options.agents} --sb3 {options.sb3} {more}--home FOLDER"
    )


def main() -> None:
    """Measure the missing results."""
    options = parse_options()
    # The name of a recipe file may end with the task's.
    recipe = Path(options.recipe).name.removesuffix(".toml").removesuffix(f"-{options.task}")
    label = "-".join([recipe, *(change.replace("=", "-") for change in options.set)])
    name = f"nes_seeds_{options.task}" + (f"_{label}" if label != "default" else "")
    before = earlier_result(name, command_of(options), ("seeds", "taught")).get("runs", [])
    runs = {run["seed"]: run for run in before}
    options.seeds = sorted({*options.seeds, *runs})
    options.taught = max(options.taught, sum("taught" in run for run in before))

    def store(run: dict[str, Any]) -> None:
        runs[run["seed"]] = run
        values = {"runs": [runs[seed] for seed in sorted(runs)]}
        write_result(name, command_of(options), values, resumed=True)
        print(run, flush=True)

    def folder(seed: int) -> Path:
        return Path(options.home, options.task, f"{label}-seed{seed}")

    for seed in options.seeds:
        if seed not in runs:
            store(run_seed(options, seed, folder(seed)))
    for seed in options.seeds[: options.taught]:
        known = runs[seed].get("taught", {})
        results = train_agents(folder(seed) / BEST_FILE, options.agents, options.sb3, known)
        if results != known:
            store({**runs[seed], "taught": results})


if __name__ == "__main__":
    main()
