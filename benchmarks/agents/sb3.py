"""Agents of Stable-Baselines3 on the SEs of the zoo, and on the real task for as many steps.

    python -m benchmarks.agents.sb3

They have the hyperparameters of RL Baselines3 Zoo for CartPole, a discount of 0.99, and take
`terminated` as a boolean.
"""

import argparse
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import gymnasium
import numpy as np

import bilevel  # noqa: F401  (registers the environments)
from benchmarks.arguments import format_seeds, parse_seeds
from benchmarks.machine import read_result, write_result
from benchmarks.markdown import mean_and_range, source, table
from bilevel.tasks import get_task
from bilevel.zoo import ENTRIES, env_id, get_entry

KINDS = ("DQN", "PPO")
STEPS = (2_500, 5_000, 10_000)
#: First seed of the tests: those of training begin at 0, so that no agent is tested from initial
#: states that it was trained from.
_TESTS = 1_000_000


def trained(kind: str, make: Callable[[], Any], steps: int, seed: int) -> Any:
    """An agent trained for that many steps on the environments that `make` makes."""
    import torch
    from stable_baselines3 import DQN, PPO
    from stable_baselines3.common.env_util import make_vec_env

    torch.set_num_threads(1)
    if kind == "DQN":
        agent: Any = DQN(
            "MlpPolicy",
            make(),
            learning_rate=2.3e-3,
            batch_size=64,
            buffer_size=100_000,
            learning_starts=1000,
            gamma=0.99,
            target_update_interval=10,
            train_freq=256,
            gradient_steps=128,
            exploration_fraction=0.16,
            exploration_final_eps=0.04,
            policy_kwargs={"net_arch": [256, 256]},
            seed=seed,
            device="cpu",
        )
    else:
        agent = PPO(
            "MlpPolicy",
            make_vec_env(make, n_envs=8, seed=seed),
            n_steps=32,
            batch_size=256,
            gae_lambda=0.8,
            gamma=0.99,
            n_epochs=20,
            ent_coef=0.0,
            learning_rate=lambda left: 1e-3 * left,
            clip_range=lambda left: 0.2 * left,
            seed=seed,
            device="cpu",
        )
    agent.learn(steps)
    return agent


def score(agent: Any, env: Any, seed: int) -> float:
    """Mean return in 20 episodes of an environment of an agent that was trained with this seed."""
    from stable_baselines3.common.evaluation import evaluate_policy

    recorded = gymnasium.wrappers.RecordEpisodeStatistics(env)
    recorded.reset(seed=_TESTS + seed)
    returns, _ = evaluate_policy(
        agent, recorded, n_eval_episodes=20, warn=False, return_episode_rewards=True
    )
    return float(np.mean(returns))


def _one(name: str, kind: str, on_se: bool, steps: int, seed: int) -> float:
    task = get_task(get_entry(name).task)
    make = (lambda: gymnasium.make(env_id(name))) if on_se else task.make
    return round(score(trained(kind, make, steps, seed), task.make(), seed), 1)


def main() -> None:
    """Train all, and write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=parse_seeds, default="0-4", help="such as 0-4")
    parser.add_argument(
        "--ses", nargs="+", choices=[*ENTRIES], default=[*ENTRIES], help="measured anew"
    )
    options = parser.parse_args()
    seeds = options.seeds
    command = f"python -m benchmarks.agents.sb3 --seeds {format_seeds(seeds)}"
    rows = []
    if others := set(ENTRIES) - set(options.ses):
        before = read_result("sb3")
        if before["command"] != command:
            parser.error(f"the other SEs were measured by {before['command']!r}")
        rows = [row for row in before["rows"] if row["se"] in others]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for name in options.ses:
            for kind in KINDS:
                for steps in STEPS:
                    row: dict[str, Any] = {"se": name, "kind": kind, "steps": steps}
                    for where, on_se in (("synthetic", True), ("real", False)):
                        jobs = [pool.submit(_one, name, kind, on_se, steps, seed) for seed in seeds]
                        row[where] = [job.result() for job in jobs]
                    rows.append(row)
                    print(row, flush=True)
    rows.sort(key=lambda row: [*ENTRIES].index(row["se"]))
    write_result("sb3", command, {"rows": rows})


def sb3() -> str:
    """The table of docs/zoo.md."""
    result = read_result("sb3")
    head = ["SE", "agent", "training steps", "trained on the SE", "trained on the real task"]
    rows = [
        [f"`{env_id(row['se'])}`", row["kind"], row["steps"], *map(mean_and_range, _both(row))]
        for row in result["rows"]
    ]
    return f"{table(head, rows)}\n\n{source(result)}"


def _both(row: dict[str, Any]) -> tuple[list[float], list[float]]:
    return row["synthetic"], row["real"]


if __name__ == "__main__":
    main()
