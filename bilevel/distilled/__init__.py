"""The supervised baseline: an SE distilled from action values learned offline on the real task.

This baseline does not use NES. It is off by default (`--recipe distilled`), and its steps on the
real task are counted.

    D <- steps of random actions on the real task
    Q <- double Q-learning on D alone; its first snapshot that solves the task, or else the best
    D <- D and twice as many steps of Q's greedy policy, with some random actions
    A <- mean advantages Q(s, a) - mean_a' Q(s, a') of several new Q, each learned on D
    D <- D with initial states of the task in place of episode ends, if it rewards survival
    next-state network <- regression on the next states of D
    reward network     <- regression on 0.5 + tanh(2 A / std A)
    done network       <- regression on the episode ends of D; LEAST_DONE elsewhere

Advantages as rewards show an agent after one step which action is better; the task's own rewards
show it only after many steps. The tanh bounds the rewards, so that small advantages are learned as
well. The stopping rule compares returns by their ratio: with BASE added, returns of good agents are
far from 0 and differ little, those of bad agents are near 0 and differ much. Agents treat the raw
done output as the probability that the episode ends: with at least LEAST_DONE they look about two
steps ahead instead of a hundred, and learn such short-sighted values in few steps.

If the task rewards survival, the episodes of untrained agents are short, and the stopping rule
would stop agents before they learn. So their SE is a continuing task without episode ends. If the
task rewards reaching an end, untrained agents train for long anyway.

The steps of Q's policy cover the states that good agents visit. Averaging several Q reduces their
individual errors.

Sources: Q-learning on recorded transitions is due to Ernst et al. (2005) and Riedmiller (2005).
Potential-based shaping by the values (Ng et al., 1999) gives advantages on average. Adding steps of
the learned policy follows Ross et al. (2011).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bilevel.activations import CODES, PRELU_INITIAL_SLOPE
from bilevel.distilled.action_values import SMALL, ActionValues
from bilevel.kernels.offline import fit, regression
from bilevel.seeds import split
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task
from bilevel.tasks.transitions import Transitions
from bilevel.threads import one_blas_thread

#: Probability that a random action replaces one of the policy's.
EXPLORATION = 0.3

#: Reward of an action with advantage 0.
BASE = 0.5

#: Raw done output where no episode ends; an episode ends above 0.5.
LEAST_DONE = 0.45

#: Learning rate and batch size of the regressions.
FIT_RATE, FIT_BATCH = 1e-2, 256


class Effort(NamedTuple):
    """How much is recorded and learned for one SE."""

    random_steps: int = 10_000  # on the real task
    policy_steps: int = 20_000  # on the real task
    snapshots: int = 40  # of each Q, at most
    teachers: int = 3  # the advantages of those that solve the task (or else the best) are averaged
    fit_steps: int = 20_000  # of each regression


#: The effort of a distilled SE that is worth training on.
FULL = Effort()


class Lessons(NamedTuple):
    """Training data of the regressions, independent of the SE's architecture."""

    data: Transitions  # N steps
    rewards: NDArray[np.float32]  # (N,) between BASE - 1 and BASE + 1
    seed: int  # of the regressions
    real_env_steps: int  # recorded steps, and those of the tests of snapshots


class DistilledSE(NamedTuple):
    """A distilled SE, and the number of steps made on the real task for it."""

    se: SE
    real_env_steps: int


def distill(
    task: Task, architecture: Architecture, seed: int, effort: Effort = FULL
) -> DistilledSE:
    """Distil an SE from action values of `task`; the result depends on `seed` and `effort` alone.

    With full effort this takes seconds. The SE's rewards are fitted to values between BASE - 1 and
    BASE + 1.
    """
    with one_blas_thread():
        taught = lessons(task, seed, effort)
        psi = _regressed(architecture, taught, effort.fit_steps)
        return DistilledSE(SE(architecture, psi), taught.real_env_steps)


def lessons(task: Task, seed: int, effort: Effort) -> Lessons:
    """Record steps on the real task and reward their actions; depends on `seed` and `effort`
    alone."""
    recording, first, following, fitting, *teaching = split(seed, 4 + effort.teachers)
    snapshots = effort.snapshots
    with one_blas_thread():
        data = Transitions.recorded(task, effort.random_steps, recording)
        policy = ActionValues.learned(task, data, first, snapshots)
        data += Transitions.recorded(
            task, effort.policy_steps, following, policy.greedy, EXPLORATION
        )
        teachers = [ActionValues.learned(task, data, seed, snapshots) for seed in teaching]
        rewards = np.float32(BASE) + np.tanh(np.float32(2) * advantages(task, data, teachers))
    tested = sum(values.real_env_steps for values in (policy, *teachers))
    data_of_se = data.of_continuing_task() if data.reward_survival else data
    return Lessons(data_of_se, rewards, fitting, len(data.states) + tested)


def advantages(task: Task, data: Transitions, teachers: list[ActionValues]) -> NDArray[np.float32]:
    """Mean advantages (N,) of the recorded actions, with unit standard deviation over all
    actions."""
    enough = min(task.solved_reward, max(teacher.score for teacher in teachers))
    good = [teacher for teacher in teachers if teacher.score >= enough]
    mean: NDArray[np.float32] = np.mean([t.advantages(data.states) for t in good], axis=0)
    mean /= mean.std() + np.float32(SMALL)
    return mean[np.arange(len(mean)), data.actions]


def _regressed(architecture: Architecture, taught: Lessons, steps: int) -> NDArray[np.float32]:
    """psi (P,), each network fitted to its column of the data."""
    data, rewards, seed, _ = taught
    actions = np.eye(architecture.n_actions, dtype=np.float32)[data.actions]
    inputs = np.column_stack([actions, data.states])
    spread = data.next_states.std(axis=0) + SMALL
    # The few ends weigh as much as all other steps together, so that the SE learns them.
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
            steps,
            FIT_RATE,
            np.array([(seed + number) % 2**64], np.uint64),
        )
        part[...] = params[: part.size]
    return psi
