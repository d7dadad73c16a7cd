"""The transitions of one evaluation, for pictures of what an agent saw."""

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.agent import Agent, Transition
from bilevel.agents.training import returns_converged, train
from bilevel.evaluation import definition, environment_in_python, greedy_episodes
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.seeds import split
from bilevel.synthetic_env import SE
from bilevel.tasks import Task
from bilevel.threads import one_torch_thread


def record(
    task: Task, se: SE, hp: AgentHyperparameters, seed: int
) -> tuple[list[Transition], list[Transition]]:
    """Transitions of the training on `se` and of the tests on the real task that
    `bilevel.evaluation.train_and_test` makes with these arguments, by the agent's definition; no
    tests if training diverges. Raises InvalidInput for an SE of a task with other sizes."""
    se.architecture.check_fits(task)
    agent_seed, physics_seed, test_seed = split(seed, 3)
    with one_torch_thread():
        agent = _Recorder(definition(task, hp, agent_seed))
        with environment_in_python(task, se, hp.max_episodes, physics_seed) as env:
            _, _, finite = train(agent, hp, env, returns_converged(hp))
        tests: list[Transition] = []
        if finite:
            for episode in greedy_episodes(task, agent.greedy, hp.test_episodes, test_seed):
                tests += episode
    return agent.observed, tests


class _Recorder:
    """An agent that keeps what it observes."""

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self.observed: list[Transition] = []

    def act(self, state: NDArray[np.float32], exploring: bool) -> int:
        """See `Agent`."""
        return self._agent.act(state, exploring)

    def greedy(self, state: NDArray[np.float32]) -> int:
        """See `Agent`."""
        return self._agent.greedy(state)

    def observe(self, transition: Transition) -> None:
        """Keep the transition."""
        self.observed.append(transition)
        self._agent.observe(transition)

    def learn(self) -> float:
        """See `Agent`."""
        return self._agent.learn()

    def end_episode(self) -> None:
        """See `Agent`."""
        self._agent.end_episode()
