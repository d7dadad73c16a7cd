"""TrainAgent in Python (paper, Algorithm 1), for any agent, on any environment.

`bilevel.kernels.training` is its compiled twin.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.agent import Agent, Transition
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.kernels.stopping import converged, solved


class TrainingEnvironment(Protocol):
    """What the agent trains on: an SE or a real task."""

    @property
    def step_limit(self) -> int:
        """Steps of an episode at most."""

    def reset(self, episode: int) -> NDArray[np.float32]:
        """The initial state (S,) of an episode."""

    def step(self, action: int) -> tuple[NDArray[np.float32], float, float]:
        """Next state (S,), reward, raw done (ends the episode above 0.5)."""


#: Told the returns of the episodes so far, decides whether training is over.
StoppingRule = Callable[[list[float]], bool]


def returns_converged(hp: AgentHyperparameters) -> StoppingRule:
    """The rule on an SE (see `bilevel.kernels.stopping`)."""

    def stop(returns: list[float]) -> bool:
        return bool(
            converged(
                np.array(returns),
                len(returns) - 1,
                hp.init_episodes,
                hp.early_out_episodes,
                hp.early_out_difference,
            )
        )

    return stop


def task_solved(hp: AgentHyperparameters, solved_reward: float) -> StoppingRule:
    """The rule on the real task (see `bilevel.kernels.stopping`)."""

    def stop(returns: list[float]) -> bool:
        return bool(
            solved(
                np.array(returns),
                len(returns) - 1,
                hp.init_episodes,
                hp.early_out_episodes,
                solved_reward,
            )
        )

    return stop


def train(
    agent: Agent, hp: AgentHyperparameters, environment: TrainingEnvironment, stop: StoppingRule
) -> tuple[int, int, bool]:
    """Train until `stop` says so, the numbers diverge, or the episodes are spent.

    for each episode:                            # at most max_episodes
        for each step:                           # at most step_limit
            act, observe the transition
            learn                                # once init_episodes are over

    Returns steps, episodes and whether all numbers stayed finite.
    """
    returns: list[float] = []
    steps = 0
    for episode in range(hp.max_episodes):
        exploring = episode < hp.init_episodes
        state = environment.reset(episode)
        total = 0.0
        for _ in range(environment.step_limit):
            action = agent.act(state, exploring)
            next_state, reward, done = environment.step(action)
            if not np.isfinite([*next_state, reward, done]).all():
                return steps, episode, False
            agent.observe(Transition(state, action, reward, next_state, done))
            state = next_state
            total += reward
            steps += 1
            if not exploring and not np.isfinite(agent.learn()):
                return steps, episode, False
            if done > 0.5:
                break
        agent.end_episode()
        returns.append(total)
        if stop(returns):
            break
    return steps, len(returns), True
