"""Action values of a real task, learned from recorded steps alone."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation.run import real_returns
from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.kernels import ddqn
from bilevel.kernels.offline import learn_offline
from bilevel.seeds import split
from bilevel.tasks import Task
from bilevel.tasks.transitions import Transitions

#: Gradient steps between two snapshots of Q, and test episodes of each snapshot.
SNAPSHOT_STEPS, TESTS = 500, 10

#: Added to divisors to keep them from zero.
SMALL = 1e-6

#: The agent whose Q-network learns.
_LEARNER = DDQNHyperparameters(
    init_episodes=0,
    batch_size=256,
    learning_rate=5e-4,
    target_update_rate=0.01,
    discount=0.99,
    initial_epsilon=1.0,
    minimal_epsilon=0.01,
    epsilon_decay=0.9,
    hidden_layers=2,
    hidden_size=64,
    activation="relu",
    replay_capacity=1,
    max_episodes=1,
    early_out_episodes=1,
    early_out_difference=0.01,
    test_episodes=TESTS,
)


@dataclass(frozen=True)
class ActionValues:
    """Q(s, a), and the score of its greedy policy on the real task."""

    agent: ddqn.DDQNKernel
    score: float
    real_env_steps: int = 0  # of the tests of all snapshots

    @classmethod
    def learned(cls, task: Task, data: Transitions, seed: int, snapshots: int) -> Self:
        """Double Q-learning; returns the first of `snapshots` that solves the task, or the best.

        Snapshots are tested on the real task, because the quality of Q-learning on a fixed data
        set fluctuates.
        """
        learning, testing = split(seed, 2)
        mean, scale = data.states.mean(axis=0), data.states.std(axis=0) + SMALL
        states, next_states = ((s - mean) / scale for s in (data.states, data.next_states))
        rewards = data.rewards * (
            1 - _LEARNER.discount
        )  # so that values have the scale of the rewards
        columns = [states, next_states, rewards, data.ends, data.actions]
        memory = np.ascontiguousarray(np.column_stack(columns), np.float32)
        hp, rng = replace(_LEARNER, replay_capacity=len(memory)), np.random.default_rng(learning)
        agent = ddqn.new_agent(hp, task.state_size, task.n_actions, rng)
        draws = np.array([learning], np.uint64)
        best = cls(agent._replace(theta=of_raw_states(agent, mean, scale)), -np.inf)
        tested = 0
        for _ in range(snapshots):
            learn_offline(agent, memory, SNAPSHOT_STEPS, draws)
            if not np.isfinite(agent.theta).all():
                break
            snapshot = agent._replace(theta=of_raw_states(agent, mean, scale))
            returns, steps = real_returns(task, snapshot, TESTS, testing)
            score, tested = float(returns.mean()), tested + steps
            if score > best.score:
                best = cls(snapshot, score)
            if score >= task.solved_reward:
                break
        return replace(best, real_env_steps=tested)

    def greedy(self, state: NDArray[np.float32]) -> int:
        """The action with the highest value in a state (S,)."""
        return int(ddqn.greedy_action(self.agent, state))

    def advantages(self, states: NDArray[np.float32]) -> NDArray[np.float32]:
        """Q(s, a) - mean_a' Q(s, a') (N, A) in states (N, S), scaled to unit standard deviation."""
        x = np.ascontiguousarray(states.T)
        h = np.empty((_LEARNER.hidden_layers, _LEARNER.hidden_size, len(states)), np.float32)
        q = np.empty((self.agent.q.shape[0], len(states)), np.float32)
        ddqn.action_values(self.agent, self.agent.theta, x, h, np.empty_like(h), q)
        above: NDArray[np.float32] = (q - q.mean(axis=0)).T
        above /= above.std() + np.float32(SMALL)
        return above


def of_raw_states(
    agent: ddqn.DDQNKernel, mean: NDArray[np.float32], scale: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Parameters theta with the normalisation (s - mean) / scale folded into the first layer."""
    theta, (inputs, units) = agent.theta.copy(), agent.net.shapes[0]
    weights = theta[: units * inputs].reshape(units, inputs)
    weights /= scale
    theta[units * inputs : units * (inputs + 1)] -= weights @ mean
    return theta
