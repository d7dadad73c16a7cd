"""An SE that is fitted to the real task, as a start for NES.

    D <- steps of random actions on the real task
    Q <- double Q-learning on D alone; of its snapshots, the one that does best on the task
    next-state network <- regression on the next states of D
    reward network     <- regression on 1 + tanh(2 A / std A), A = Q(s, a) - mean_a' Q(s, a')
    done network       <- regression on the ends of D; LEAST_DONE where there is none

Rewards that are advantages tell an agent after one step which action is the better one;
the task's own rewards tell it after many. They are bounded, so that what matters little in
the end is learned as well, and positive: the stopping rule compares returns by their ratio.
To an agent the raw done output is the probability that nothing follows: where it is never
less than LEAST_DONE, an agent looks two steps ahead instead of a hundred, and learns what
they are worth in few steps, as all agents do.

Q-learning on recorded transitions: Ernst et al. (2005), Riedmiller (2005). Advantages as
rewards: potential-based shaping by the values (Ng et al., 1999) gives them on average.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.kernels import ddqn
from bilevel.kernels.activations import CODES, PRELU_INITIAL_SLOPE
from bilevel.kernels.blas import one_blas_thread
from bilevel.kernels.offline import fit, learn_offline, regression
from bilevel.synthetic_env.architecture import Architecture
from bilevel.tasks import Task

#: Steps on the real task, and how often a random action is repeated at most: of actions
#: that change every step, tasks with momentum (Acrobot) see little.
STEPS, REPEATS = 20_000, 4

#: The raw done output where no episode ends; above 0.5 one would.
LEAST_DONE = 0.45

#: Snapshots of Q, the gradient steps between them, and the test episodes of each.
_SNAPSHOTS, _SNAPSHOT_STEPS, _TESTS = 40, 500, 10

#: Of the regressions.
_FIT_STEPS, _FIT_RATE, _FIT_BATCH = 20_000, 1e-2, 256

#: Keeps what is divided by away from zero.
_SMALL = 1e-6


def fitted_psi(task: Task, architecture: Architecture, seed: int) -> NDArray[np.float32]:
    """psi (P,) of an SE fitted to `task`; by `seed` alone.

    Its rewards lie between 0 and 2, times `architecture.reward_scale`.
    """
    collecting, learning, testing, fitting = (
        int(word) for word in np.random.SeedSequence(seed).generate_state(4, np.uint64)
    )
    data = Transitions.random(task, STEPS, collecting)
    with one_blas_thread():
        values = _action_values(task, data, learning, testing)
        advantages = values - values.mean(axis=1, keepdims=True)
        taken = advantages[np.arange(len(values)), data.actions]
        rewards = 1 + np.tanh(2 * taken / (advantages.std() + _SMALL))
        return _regressed(architecture, data, architecture.reward_scale * rewards, fitting)


@dataclass(frozen=True)
class Transitions:
    """N recorded steps on a real task."""

    states: NDArray[np.float32]  # (N, S)
    actions: NDArray[np.int64]  # (N,)
    next_states: NDArray[np.float32]  # (N, S)
    rewards: NDArray[np.float32]  # (N,)
    ends: NDArray[np.float32]  # (N,) 1 where the task ended, not at its step limit

    @classmethod
    def random(cls, task: Task, steps: int, seed: int) -> Self:
        """Of random actions, each repeated 1 to REPEATS times."""
        rng = np.random.default_rng(seed)
        env = task.make()
        first = env.action_space.start  # type: ignore[attr-defined]
        rows: list[tuple[Any, ...]] = []
        state, left, action = None, 0, 0
        while len(rows) < steps:
            if state is None:
                state, left = env.reset(seed=int(rng.integers(2**31)))[0], 0
            if not left:
                action, left = int(rng.integers(task.n_actions)), int(rng.integers(REPEATS)) + 1
            left -= 1
            following, reward, terminated, truncated, _ = env.step(first + action)
            rows.append((state, action, following, float(reward), terminated))
            state = None if terminated or truncated else following
        env.close()
        states, actions, next_states, rewards, ends = zip(*rows, strict=True)
        return cls(
            np.array(states, np.float32),
            np.array(actions, np.int64),
            np.array(next_states, np.float32),
            np.array(rewards, np.float32),
            np.array(ends, np.float32),
        )


#: The agent whose Q-network learns the action values.
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
    replay_capacity=STEPS,
    max_episodes=1,
    early_out_episodes=1,
    early_out_difference=0.01,
    test_episodes=_TESTS,
)


def _action_values(
    task: Task, data: Transitions, learning: int, testing: int
) -> NDArray[np.float32]:
    """Q(s, a) (N, A) in the recorded states.

    What Q-learning on a fixed set of transitions knows is good at one time and bad a little
    later, so its snapshots are tested on the real task.
    """
    mean, scale = data.states.mean(axis=0), data.states.std(axis=0) + _SMALL
    states, next_states = ((s - mean) / scale for s in (data.states, data.next_states))
    rewards = data.rewards * (1 - _LEARNER.discount)  # values are then of the rewards' size
    columns = [states, next_states, rewards, data.ends, data.actions]
    memory = np.ascontiguousarray(np.column_stack(columns), np.float32)
    rng = np.random.default_rng(learning)
    agent = ddqn.new_agent(_LEARNER, task.state_size, task.n_actions, rng)
    draws = np.array([learning], np.uint64)
    best, theta = -np.inf, agent.theta.copy()
    for _ in range(_SNAPSHOTS):
        learn_offline(agent, memory, _SNAPSHOT_STEPS, draws)
        if not np.isfinite(agent.theta).all():
            break
        score = task.test_returns(
            lambda state: int(ddqn.greedy_action(agent, (state - mean) / scale)),
            _TESTS,
            testing % 2**31,
        ).mean()
        if score > best:
            best, theta = score, agent.theta.copy()
        if score >= task.solved_reward:
            break
    return _values(agent, theta, states)


def _values(
    agent: ddqn.DDQNKernel, theta: NDArray[np.float32], states: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Q(s, a) (N, A) of many states (N, S) at once."""
    h = np.empty((_LEARNER.hidden_layers, _LEARNER.hidden_size, len(states)), np.float32)
    q = np.empty((agent.q.shape[0], len(states)), np.float32)
    ddqn.action_values(agent, theta, np.ascontiguousarray(states.T), h, np.empty_like(h), q)
    return q.T


def _regressed(
    architecture: Architecture, data: Transitions, rewards: NDArray[np.float32], seed: int
) -> NDArray[np.float32]:
    """psi (P,), each network fitted to its column of the data."""
    actions = np.eye(architecture.n_actions, dtype=np.float32)[data.actions]
    inputs = np.column_stack([actions, data.states])
    spread = data.next_states.std(axis=0) + _SMALL
    # The few ends count as much as all other steps together: an SE shall not miss them.
    share = np.clip(data.ends.mean(), 1 / data.ends.size, 0.5)
    balance = np.where(data.ends > 0, 0.5 / share, 0.5 / (1 - share))
    targets_and_weights = (
        (data.next_states, np.broadcast_to(spread**-2, data.next_states.shape)),
        (rewards[:, None], np.ones((len(rewards), 1))),
        (np.maximum(data.ends, LEAST_DONE)[:, None], balance[:, None]),
    )
    psi = architecture.initialize(np.random.default_rng(seed))
    parts = zip(architecture.networks, architecture.split(psi), targets_and_weights, strict=True)
    for number, (net, part, (targets, weights)) in enumerate(parts):
        net = net._replace(activation=CODES[architecture.activation])
        params = np.append(part, np.float32(PRELU_INITIAL_SLOPE))[: net.parameter_count]
        fit(
            regression(net, params, _FIT_BATCH),
            inputs,
            np.ascontiguousarray(targets, np.float32),
            np.ascontiguousarray(weights, np.float32),
            _FIT_BATCH,
            _FIT_STEPS,
            _FIT_RATE,
            np.array([(seed + number) % 2**64], np.uint64),
        )
        part[...] = params[: part.size]
    return psi
