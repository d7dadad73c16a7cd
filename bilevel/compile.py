"""Compile all kernels once, into the disk cache: `python -m bilevel.compile`."""

from dataclasses import replace

import numpy as np

from bilevel.agents import get_agent, registered_agents
from bilevel.distilled import distill
from bilevel.evaluation import EvaluationRequest, evaluate, train_and_test
from bilevel.hyperparameters import load_recipe
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import get_task


def main() -> None:
    """Run the smallest evaluation of every agent that goes through every kernel; distil an SE."""
    task = get_task("CartPole-v0")
    for name in registered_agents():
        if get_agent(name).build_kernel is None:
            continue
        hp = load_recipe("paper", task.id, agents=(name,))
        agent = replace(hp.agents[0], max_episodes=2, init_episodes=0, test_episodes=1)
        shape = Architecture.of(task, hp.se)
        psi = shape.initialize(np.random.default_rng(0))
        evaluate(task, SE(shape, psi), EvaluationRequest(0, 0, agent))
        train_and_test(task, None, agent, 0)
    distill(task, shape, 0)


if __name__ == "__main__":
    main()
