"""Compile what NES runs and the distillation call, once, into the disk cache: `python -m
bilevel.compile`. (The entry points of gymnasium's environments compile on first use.)"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np

from bilevel.agents import get_agent, registered_agents
from bilevel.distilled import Effort, distill
from bilevel.evaluation import EvaluationRequest, evaluate, train_and_test
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import get_task

_TASK = "CartPole-v0"

#: A distillation that calls all kernels, and whose SE nobody uses.
_LEAST = Effort(random_steps=64, policy_steps=64, snapshots=1, teachers=1, fit_steps=1)


def compile_agent(name: str) -> None:
    """Run the smallest evaluation that calls all kernels of an agent."""
    task = get_task(_TASK)
    hp = load_recipe("paper", task.id, agents=(name,))
    agent = replace(hp.agents[0], max_episodes=2, init_episodes=0, test_episodes=1)
    shape = Architecture.of(task, hp.se)
    psi = shape.initialize(np.random.default_rng(0))
    evaluate(task, SE(shape, psi), EvaluationRequest(0, 0, agent))
    train_and_test(task, None, agent, 0)


def compile_scale_and_distillation() -> None:
    """Measure the scale of observations, and distil an SE, which calls all kernels of the
    supervised baseline."""
    task = get_task(_TASK)
    task.observation_scale(0)
    distill(task, Architecture.of(task, load_recipe("paper", task.id).se), 0, _LEAST)


def main() -> None:
    """Compile all kernels on all cores, the slowest first."""
    agents = [name for name in registered_agents() if get_agent(name).build_kernel is not None]
    agents.sort(key=lambda name: name != "td3")
    with ProcessPoolExecutor() as pool:
        jobs = [pool.submit(compile_agent, name) for name in agents]
        jobs.append(pool.submit(compile_scale_and_distillation))
        for job in jobs:
            job.result()


if __name__ == "__main__":
    main()
