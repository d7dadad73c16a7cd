"""Compile the kernels of all agents into the disk cache: `python -m bilevel.compile`."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

from bilevel.agents import get_agent, registered_agents
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import default_agents
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import get_task


def compile_agent(name: str, continuous: bool) -> None:
    """Run the shortest training and tests that call all kernels of an agent, and measure a task's
    scale of observations."""
    task = replace(get_task("Pendulum-v1" if continuous else "CartPole-v0"), step_limit=1)
    (hp,) = default_agents((name,))
    hp = replace(hp, max_episodes=1, init_episodes=0, test_episodes=1)
    sizes = task.state_size, task.action_size
    architecture = Architecture(*sizes, 1, 1, "lrelu", 1, task.continuous)
    se = SE(architecture, np.zeros(architecture.parameter_count, np.float32))
    train_and_test(task, se, hp, seed=0)
    task.observation_scale(seed=0)


def main() -> None:
    """Compile all kernels on all cores, the slowest first."""
    kinds = [(name, kind) for kind in (False, True) for name in registered_agents(kind)]
    kinds = [kind for kind in kinds if get_agent(*kind).build_kernel is not None]
    kinds.sort(key=lambda kind: kind[0] not in ("td3", "ppo"))
    with ProcessPoolExecutor() as pool:
        list(pool.map(compile_agent, *zip(*kinds, strict=True)))


if __name__ == "__main__":
    main()
