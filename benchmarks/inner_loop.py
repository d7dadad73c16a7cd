"""One inner-loop step (environment step plus gradient step) of DDQN on an SE: the
compiled kernel against the torch definition, in turn, in one process, on one core.

    python -m benchmarks.inner_loop
"""

import statistics
import time
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.machine import write_result
from bilevel.agents.ddqn import DDQN
from bilevel.evaluation import settings
from bilevel.hyperparameters import Hyperparameters, load_preset
from bilevel.kernels import ddqn, mlp
from bilevel.kernels.random import SplitMix64
from bilevel.kernels.synthetic_env import step
from bilevel.synthetic_env import Architecture, kernel_form
from bilevel.tasks import Task, get_task

REPEATS = 7
#: Training episodes of one measurement (each of 200 steps or more, as the SE's done
#: output is silenced); every episode learns.
KERNEL_EPISODES, TORCH_EPISODES = 60, 3
EPISODE_STEPS = 200


class TorchSE:
    """The SE as the definition trains on it."""

    def __init__(self, environment: ddqn.Environment) -> None:
        self.environment = environment
        self.state = np.zeros(environment.state_size, np.float32)
        self.work = np.zeros((2, environment.se.action_biases.shape[1]), np.float32)

    def reset(self, episode: int) -> NDArray[np.float32]:
        self.state = np.zeros_like(self.state) + np.float32(episode * 1e-3)
        return self.state

    def step(self, action: int) -> tuple[NDArray[np.float32], float, float]:
        next_state = np.empty_like(self.state)
        reward, done = step(self.environment.se, self.state, action, next_state, self.work)
        self.state = next_state
        return next_state, float(reward), float(done)


def measure(task: Task, hp: Hyperparameters) -> dict[str, object]:
    """Microseconds per step of both, and their ratio, over `REPEATS` pairs."""
    agent = replace(hp.agent, init_episodes=0)
    architecture = Architecture.of(task, hp.se)
    psi = architecture.initialize(np.random.default_rng(0)) * np.float32(0.3)
    kernel_se = kernel_form(architecture, psi)
    kernel_se.output_biases[-1] = -10.0  # never done: all episodes have the same length
    physics = task.initial_physics(np.random.default_rng(1), KERNEL_EPISODES)
    environment = ddqn.Environment(
        True, kernel_se, task.dynamics, task.state_size, EPISODE_STEPS, 0.0, physics
    )
    net = mlp.network(
        task.state_size, agent.hidden_size, agent.hidden_layers, task.n_actions, agent.activation
    )
    theta = mlp.initial_parameters(net, np.random.default_rng(2))

    def kernel(episodes: int) -> float:
        never = replace(agent, max_episodes=episodes, early_out_episodes=10**6)
        learner = ddqn.new_learner(net, theta, agent.batch_size)
        started = time.perf_counter()
        steps, _, _ = ddqn.train(
            learner, environment, environment, settings(never), np.array([0], np.uint64)
        )
        return (time.perf_counter() - started) / int(steps) * 1e6

    def definition(episodes: int) -> float:
        never = replace(agent, max_episodes=episodes)
        learner = DDQN(never, task.state_size, task.n_actions, theta, SplitMix64(0))
        started = time.perf_counter()
        learner.train(TorchSE(environment), EPISODE_STEPS, lambda returns: False)
        return (time.perf_counter() - started) / learner.steps * 1e6

    kernel(2)
    definition(1)
    pairs = [(kernel(KERNEL_EPISODES), definition(TORCH_EPISODES)) for _ in range(REPEATS)]
    return {
        "kernel_us": spread([k for k, _ in pairs]),
        "torch_us": spread([t for _, t in pairs]),
        "ratio": spread([t / k for k, t in pairs]),
    }


def spread(values: list[float]) -> dict[str, float]:
    """Median, lowest and highest."""
    return {
        "median": round(statistics.median(values), 2),
        "low": round(min(values), 2),
        "high": round(max(values), 2),
    }


def main() -> None:
    """Measure all agents, print a table, write `results/inner_loop.json`."""
    torch.set_num_threads(1)
    cases = {
        "CartPole, Table 1": ("CartPole-v0", "tuned"),
        "Acrobot, Table 1": ("Acrobot-v1", "tuned"),
        "CartPole, default (2 x 128)": ("CartPole-v0", "default"),
    }
    results = {}
    print("| agent | kernel us/step | torch us/step | ratio |\n| --- | --- | --- | --- |")
    with threadpool_limits(1):
        for name, (task_id, preset) in cases.items():
            results[name] = measure(get_task(task_id), load_preset(preset, task_id))
            cells = [
                f"{v['median']} ({v['low']} to {v['high']})"  # type: ignore[index]
                for v in results[name].values()
            ]
            print(f"| {name} | {' | '.join(cells)} |", flush=True)
    path = write_result(
        "inner_loop",
        "python -m benchmarks.inner_loop",
        {"repeats": REPEATS, "unit": "microseconds per step, one core", "results": results},
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
