"""TrainAgent in Python (paper, Algorithm 1), for any agent, on any environment.

`bilevel.kernels.training` is the compiled twin.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bilevel.agents.agent import Agent, Transition
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.spaces import Action


class TrainingEnvironment(Protocol):
    """Interface of the environment that an agent trains on: an SE or a real task."""

    step_limit: int  #: maximum number of steps per episode

    def reset(self, episode: int) -> NDArray[np.float32]:
        """The initial state (S,) of an episode."""

    def step(self, action: Action) -> tuple[NDArray[np.float32], float, float, bool]:
        """Take one step: next state (S,), reward, raw done, and True at the end of an episode (also
        of a truncated one, with a done output of 0)."""


#: Receives each transition.
Record = Callable[[Transition], None]

#: Returns True if training ends, given the returns of all episodes so far.
StoppingRule = Callable[[list[float]], bool]


def ignore(transition: Transition) -> None:
    """Record nothing."""


def returns_converged(hp: AgentHyperparameters) -> StoppingRule:
    """The stopping rule on an SE: the mean returns of the last d episodes and of the d before them
    differ relatively by at most C_diff (paper, "Heuristics for Agent Training and Evaluation").

    The rule applies from episode `init_episodes + d` (counted from 0) on. The earlier window may
    then contain fewer than d episodes.
    """
    d = hp.early_out_episodes

    def stop(returns: list[float]) -> bool:
        if len(returns) <= hp.init_episodes + d:
            return False
        recent, earlier = float(np.mean(returns[-d:])), float(np.mean(returns[-2 * d : -d]))
        return abs(recent - earlier) <= hp.early_out_difference * abs(earlier)

    return stop


def task_solved(hp: AgentHyperparameters, solved_reward: float) -> StoppingRule:
    """The stopping rule on the real task: the mean return of the last d episodes reaches the solved
    reward, after the initial episodes and at least d episodes.

    The paper uses test episodes here. The authors' code (`env_solved` in agents/base_agent.py of
    automl/learning_environments) uses training episodes, which reproduces their train steps.
    """
    d = hp.early_out_episodes

    def stop(returns: list[float]) -> bool:
        if len(returns) <= hp.init_episodes or len(returns) < d:
            return False
        return float(np.mean(returns[-d:])) >= solved_reward

    return stop


def train(
    agent: Agent,
    hp: AgentHyperparameters,
    environment: TrainingEnvironment,
    stop: StoppingRule,
    record: Record = ignore,
) -> tuple[int, int, bool]:
    """Train until `stop` returns true, a value is not finite, or all episodes were run.

    for each episode:                            # at most max_episodes
        for each step:                           # at most step_limit
            act, observe the transition
            learn                                # after init_episodes

    Calls `record` with each transition. Returns the numbers of steps and episodes, and True if all
    values stayed finite.
    """
    returns: list[float] = []
    steps = 0
    for episode in range(hp.max_episodes):
        exploring = episode < hp.init_episodes
        state = environment.reset(episode)
        total = 0.0
        for _ in range(environment.step_limit):
            action = agent.act(state, exploring)
            next_state, reward, done, over = environment.step(action)
            if not np.isfinite([*next_state, reward, done]).all():
                return steps, episode, False
            transition = Transition(state, action, reward, next_state, done)
            record(transition)
            agent.observe(transition)
            state = next_state
            total += reward
            steps += 1
            if not exploring and not np.isfinite(float(agent.learn())):
                return steps, episode, False
            if over:
                break
        agent.end_episode()
        returns.append(total)
        if stop(returns):
            break
    return steps, len(returns), True
