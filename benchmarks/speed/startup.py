"""Start-up time of `bilevel nes CartPole-v0` up to its first evaluation, part by part; time to load
an SE file and to test on the real task; memory of an actor.

    python -m benchmarks.speed.startup

The command is run by `watched_command`, which reports when each part ends.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import spread, write_result
from benchmarks.speed.watched_command import PARTS
from bilevel.agents import get_agent
from bilevel.evaluation import EvaluationRequest, evaluate
from bilevel.hyperparameters import DDQNHyperparameters, Hyperparameters, load_recipe
from bilevel.kernels import training
from bilevel.kernels.environment import environment
from bilevel.synthetic_env import SE, Architecture, StoredSE, load_se, save_se
from bilevel.tasks import Task, get_task

REPEATS = 3


def start(home: Path) -> dict[str, float]:
    """Seconds of each part of one start, and in total."""
    arguments = ["nes", "CartPole-v0", "--home", str(home)]
    command = [
        sys.executable,
        "-m",
        "benchmarks.speed.watched_command",
        str(time.time()),
        *arguments,
    ]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    times = dict(json.loads(line) for line in done.stdout.splitlines() if line.startswith('["'))
    ends = [times[part] for part in PARTS]
    lengths = np.diff([0.0, *ends]).tolist()
    return {**dict(zip(PARTS, lengths, strict=True)), "all": ends[-1]}


def starts(fresh: bool) -> dict[str, dict[str, float]]:
    """`REPEATS` starts, each in a fresh home, or all in one that has been used before."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for i in range(REPEATS + (not fresh)):
            rows.append(start(Path(folder) / (str(i) if fresh else "home")))
            print(rows[-1], flush=True)
    return {part: spread([row[part] for row in rows[-REPEATS:]]) for part in rows[0]}


def random_se(task: Task, hp: Hyperparameters) -> SE:
    """A random SE of these sizes."""
    architecture = Architecture.of(task, hp.se)
    return SE(architecture, architecture.initialize(np.random.default_rng(0)))


def se_load_milliseconds() -> float:
    """Time to load a file with an SE of the paper's size for CartPole."""
    task = get_task("CartPole-v0")
    se = random_se(task, load_recipe("paper", task.id))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "se.safetensors"
        save_se(StoredSE(se, task.id, task.step_limit, task.solved_reward, {}), path)
        return _milliseconds(lambda: load_se(path), 200)


def real_task_milliseconds(task_id: str) -> float:
    """Time of ten test episodes of the optimized agent on the real task at maximum length; it is
    measured per step, because episodes of the untrained agent are shorter."""
    task, hp = get_task(task_id), load_recipe("paper", task_id)
    (agent_hp,) = hp.agents
    build = get_agent(agent_hp.agent).build_kernel
    assert build is not None
    agent = build(agent_hp, task.state_size, task.n_actions, np.random.default_rng(0))
    env = environment(
        random_se(task, hp).kernel,
        False,
        task.dynamics,
        task.state_size,
        task.step_limit,
        task.solved_reward,
        task.initial_physics(np.random.default_rng(1), 100),
    )
    _, steps = training.test_returns(agent, env, 100)
    per_step = _milliseconds(lambda: training.test_returns(agent, env, 100), 5) / int(steps)
    return float(per_step * task.step_limit * agent_hp.test_episodes)


def _milliseconds(action: Callable[[], Any], times: int) -> float:
    started = time.perf_counter()
    for _ in range(times):
        action()
    return (time.perf_counter() - started) / times * 1e3


class _Actor:
    """A pool's actor that also reports its peak memory."""

    def run(self, task_id: str, hp: Hyperparameters, seeds: int) -> float:
        """Peak memory in MiB after some evaluations."""
        task = get_task(task_id)
        se = random_se(task, hp)
        for seed in range(seeds):
            evaluate(task, se, EvaluationRequest(0, seed, hp.agents[0]))
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def actor_mebibytes() -> dict[str, float]:
    """Peak resident memory of an actor, by the agent it evaluates."""
    import ray

    from cluster.ray.connection import ray_cluster

    optimized, large = load_recipe("paper", "CartPole-v0"), load_recipe("paper", "")
    (agent,) = large.agents
    assert isinstance(agent, DDQNHyperparameters)
    widest = replace(agent, hidden_layers=3, hidden_size=384, batch_size=384, max_episodes=15)
    cases = {
        "CartPole, optimized": (optimized, 4),
        "CartPole, 3 x 384, batch 384": (replace(large, agents=(widest,)), 1),
    }
    with ray_cluster(None):
        peaks = {}
        for name, (hp, seeds) in cases.items():
            actor = ray.remote(_Actor).options(num_cpus=1).remote()
            peaks[name] = round(ray.get(actor.run.remote("CartPole-v0", hp, seeds)), 1)
            ray.kill(actor)
    return peaks


def main() -> None:
    """Measure all parts and write `results/startup.json`."""
    result = {
        "repeats": REPEATS,
        "parts": list(PARTS),
        "seconds": {"first time": starts(fresh=True), "again": starts(fresh=False)},
        "se_load_ms": round(se_load_milliseconds(), 3),
        "real_task_ms": {
            task_id: round(real_task_milliseconds(task_id), 2)
            for task_id in ("CartPole-v0", "Acrobot-v1")
        },
        "actor_peak_mib": actor_mebibytes(),
    }
    print(result)
    print(f"written to {write_result('startup', 'python -m benchmarks.speed.startup', result)}")


if __name__ == "__main__":
    main()
