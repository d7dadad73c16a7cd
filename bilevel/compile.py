"""Compile the kernels of all agents into the disk cache: `python -m bilevel.compile`."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

from bilevel.agents import get_agent, registered_agents
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import default_agents
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import get_task


def compile_agent(name: str) -> None:
    """Run the shortest training and tests that call all kernels of an agent, and measure a task's
    scale of observations."""
    task = replace(get_task("CartPole-v0"), step_limit=1)
    (hp,) = default_agents((name,))
    hp = replace(hp, max_episodes=1, init_episodes=0, test_episodes=1)
    architecture = Architecture(task.state_size, task.n_actions, 1, 1, "lrelu", step_limit=1)
    se = SE(architecture, np.zeros(architecture.parameter_count, np.float32))
    train_and_test(task, se, hp, seed=0)
    task.observation_scale(seed=0)


def main() -> None:
    """Compile all kernels on all cores, the slowest first."""
    agents = [name for name in registered_agents() if get_agent(name).build_kernel is not None]
    agents.sort(key=lambda name: name != "td3")
    with ProcessPoolExecutor() as pool:
        list(pool.map(compile_agent, agents))


if __name__ == "__main__":
    main()
