"""The supervised baseline: an SE distilled from action values learned offline on the real task.

Nothing of this is NES; it is off by default (`--recipe distilled`), and its real steps count.

    D <- steps of random actions on the real task
    Q <- double Q-learning on D alone; of its snapshots, the one that does best on the task
    D <- D and twice as many steps of Q's actions, some of them random
    A <- mean over TEACHERS other Q, learned on D, of their advantages Q(s, a) - mean_a' Q(s, a')
    D <- D with new starts of the task in place of its ends, if it rewards survival
    next-state network <- regression on the next states of D
    reward network     <- regression on 0.5 + tanh(2 A / std A)
    done network       <- regression on the ends of D; LEAST_DONE where there is none

Rewards that are advantages tell an agent after one step which action is the better one;
the task's own rewards tell it after many. They are bounded, so that what matters little in
the end is learned as well. The stopping rule compares returns by their ratio: with BASE added,
those of good agents are far from 0 and hardly differ, those of bad ones are near 0 and do.
To an agent the raw done output is the probability that nothing follows: where it is never
less than LEAST_DONE, an agent looks two steps ahead instead of a hundred, and learns what
they are worth in few steps, as all agents do.

Where the task rewards survival, agents that know nothing end its episodes soon, and learn next to
nothing before the stopping rule calls their returns converged. Their SE is a continuing task: it
starts over. Where the end is the aim, it is those that know nothing who train for long.

The steps of Q's actions show the SE where good agents will be. Several Q agree on what matters,
and are wrong in different ways.

Q-learning on recorded transitions: Ernst et al. (2005), Riedmiller (2005). Advantages as
rewards: potential-based shaping by the values (Ng et al., 1999) gives them on average.
Steps of the learned policy: Ross et al. (2011).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.activations import CODES, PRELU_INITIAL_SLOPE
from bilevel.distilled.action_values import SMALL, ActionValues
from bilevel.distilled.transitions import Transitions
from bilevel.kernels.blas import one_blas_thread
from bilevel.kernels.offline import fit, regression
from bilevel.seeds import split
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task

#: Random steps on the real task, and those of Q's policy; the probability that a
#: random action takes the place of one of these.
RANDOM_STEPS, POLICY_STEPS, EXPLORATION = 10_000, 20_000, 0.3

#: Q-networks whose advantages are averaged: those that solve the task, or else the best.
TEACHERS = 3

#: The reward of an action that is neither better nor worse than the others.
BASE = 0.5

#: The raw done output where no episode ends; above 0.5 one would.
LEAST_DONE = 0.45

#: Of the regressions.
FIT_STEPS, FIT_RATE, FIT_BATCH = 20_000, 1e-2, 256


class Lessons(NamedTuple):
    """What an SE is fitted to, whatever its networks."""

    data: Transitions  # N steps
    rewards: NDArray[np.float32]  # (N,) between BASE - 1 and BASE + 1
    seed: int  # of the regressions
    real_env_steps: int  # recorded steps, and those of the tests of snapshots


class DistilledSE(NamedTuple):
    """An SE, and what it cost on the real task."""

    se: SE
    real_env_steps: int


def distill(task: Task, architecture: Architecture, seed: int) -> DistilledSE:
    """An SE distilled from action values of `task`; by `seed` alone. It takes seconds.

    Its rewards lie between BASE - 1 and BASE + 1.
    """
    with one_blas_thread():
        taught = lessons(task, seed)
        return DistilledSE(
            SE(architecture, _regressed(architecture, taught)), taught.real_env_steps
        )


def lessons(task: Task, seed: int) -> Lessons:
    """Steps on the real task, and what their actions are worth; by `seed` alone."""
    recording, first, following, fitting, *teaching = split(seed, 4 + TEACHERS)
    with one_blas_thread():
        data = Transitions.recorded(task, RANDOM_STEPS, recording)
        policy = ActionValues.learned(task, data, first)
        data += Transitions.recorded(task, POLICY_STEPS, following, policy.greedy, EXPLORATION)
        teachers = [ActionValues.learned(task, data, seed) for seed in teaching]
        rewards = np.float32(BASE) + np.tanh(np.float32(2) * advantages(task, data, teachers))
    tested = sum(values.real_env_steps for values in (policy, *teachers))
    data_of_se = data.of_continuing_task() if data.reward_survival else data
    return Lessons(data_of_se, rewards, fitting, RANDOM_STEPS + POLICY_STEPS + tested)


def advantages(task: Task, data: Transitions, teachers: list[ActionValues]) -> NDArray[np.float32]:
    """Of the recorded actions (N,), those of all actions being of unit scale."""
    enough = min(task.solved_reward, max(teacher.score for teacher in teachers))
    good = [teacher for teacher in teachers if teacher.score >= enough]
    mean: NDArray[np.float32] = np.mean([t.advantages(data.states) for t in good], axis=0)
    mean /= mean.std() + np.float32(SMALL)
    return mean[np.arange(len(mean)), data.actions]


def _regressed(architecture: Architecture, taught: Lessons) -> NDArray[np.float32]:
    """psi (P,), each network fitted to its column of the data."""
    data, rewards, seed, _ = taught
    actions = np.eye(architecture.n_actions, dtype=np.float32)[data.actions]
    inputs = np.column_stack([actions, data.states])
    spread = data.next_states.std(axis=0) + SMALL
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
            regression(net, params, FIT_BATCH),
            inputs,
            np.ascontiguousarray(targets, np.float32),
            np.ascontiguousarray(weights, np.float32),
            FIT_BATCH,
            FIT_STEPS,
            FIT_RATE,
            np.array([(seed + number) % 2**64], np.uint64),
        )
        part[...] = params[: part.size]
    return psi
