"""Agents of Stable-Baselines3, trained on the SEs of the zoo or on the real task.

    python -m benchmarks.agents.sb3

They have the hyperparameters of RL Baselines3 Zoo for CartPole and a discount of 0.99.
"""

import argparse
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import gymnasium
import numpy as np

import bilevel  # noqa: F401  (registers the environments)
from benchmarks.machine import format_seeds, parse_seeds, read_result, write_result
from benchmarks.markdown import mean_and_range, table
from bilevel.tasks import get_task
from bilevel.zoo import ENTRIES, env_id, get_entry

KINDS = ("DQN", "PPO")
STEPS = (2_500, 5_000, 10_000)
#: First seed of the tests. Training seeds start at 0, so initial states of tests are new.
_TESTS = 1_000_000


def trained(kind: str, make: Callable[[], Any], steps: int, seed: int) -> Any:
    """Return an agent after that many train steps on environments made by `make`."""
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
    """Return the mean return over 20 episodes of an agent that was trained with this seed."""
    from stable_baselines3.common.evaluation import evaluate_policy

    recorded = gymnasium.wrappers.RecordEpisodeStatistics(env)
    recorded.reset(seed=_TESTS + seed)
    returns, _ = evaluate_policy(
        agent, recorded, n_eval_episodes=20, warn=False, return_episode_rewards=True
    )
    return float(np.mean(returns))


def train_and_score(name: str, kind: str, on_se: bool, steps: int, seed: int) -> float:
    """Train an agent on an SE of the zoo or on its real task; return its score on the task."""
    task = get_task(get_entry(name).task)
    make = (lambda: gymnasium.make(env_id(name))) if on_se else task.make
    return round(score(trained(kind, make, steps, seed), task.make(), seed), 1)


def sb3() -> str:
    """Return the table."""
    result = read_result("sb3")
    head = "SE", "agent", "training steps", "trained on the SE", "trained on the real task"
    rows = [
        (
            f"`{env_id(row['se'])}`",
            row["kind"],
            row["steps"],
            mean_and_range(row["synthetic"]),
            mean_and_range(row["real"]),
        )
        for row in result["rows"]
    ]
    return table(head, rows, result)


def main() -> None:
    """Train all agents on the tasks with discrete actions, and write `results/sb3.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=parse_seeds, default="0-4", help="such as 0-4")
    seeds = parser.parse_args().seeds
    rows = []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for name in ENTRIES:
            if get_task(name).continuous:
                continue  # DQN needs discrete actions
            for kind in KINDS:
                for steps in STEPS:
                    row: dict[str, Any] = {"se": name, "kind": kind, "steps": steps}
                    for source, on_se in (("synthetic", True), ("real", False)):
                        jobs = [
                            pool.submit(train_and_score, name, kind, on_se, steps, seed)
                            for seed in seeds
                        ]
                        row[source] = [job.result() for job in jobs]
                    rows.append(row)
                    print(row, flush=True)
    command = f"python -m benchmarks.agents.sb3 --seeds {format_seeds(seeds)}"
    write_result("sb3", command, {"rows": rows})


if __name__ == "__main__":
    main()
