"""TrainAgent in Python (paper, Algorithm 1), for any agent, on any environment.

`bilevel.kernels.training` is its compiled twin.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.agent import Agent, Transition
from bilevel.hyperparameters import AgentHyperparameters


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
    """The rule on an SE: the mean return of the last d episodes differs from that of the d before
    them by at most C_diff, relatively (paper, "Heuristics for Agent Training and Evaluation").

    Checked from episode `init_episodes + d` (counted from 0) on; then the earlier window may still
    be short of d episodes, and what there is of it counts.
    """
    d = hp.early_out_episodes

    def stop(returns: list[float]) -> bool:
        if len(returns) <= hp.init_episodes + d:
            return False
        recent, earlier = float(np.mean(returns[-d:])), float(np.mean(returns[-2 * d : -d]))
        return abs(recent - earlier) <= hp.early_out_difference * abs(earlier)

    return stop


def task_solved(hp: AgentHyperparameters, solved_reward: float) -> StoppingRule:
    """The rule on the real task: the mean return of the last d episodes reaches the solved reward,
    once the initial episodes are over. Fewer episodes than d do not count.

    The paper speaks of test episodes here; the authors' code (`env_solved` in
    agents/base_agent.py of automl/learning_environments) takes the training episodes,
    and only that comes near the steps they report.
    """
    d = hp.early_out_episodes

    def stop(returns: list[float]) -> bool:
        if len(returns) <= hp.init_episodes or len(returns) < d:
            return False
        return float(np.mean(returns[-d:])) >= solved_reward

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
