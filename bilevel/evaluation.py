"""One evaluation: train a fresh agent on an SE, score it on the real task.

An evaluation is a pure function of its request (and of psi, task and
architecture): the same request gives the same score wherever and whenever it is
run, which is what lets a pool of actors run them in any order, and again.
"""

import time
from dataclasses import dataclass

import numpy as np
import scipy.linalg.cython_blas  # noqa: F401  (the BLAS of compiled code, loaded to be limited)
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.kernels import ddqn, mlp
from bilevel.kernels.stopping import NOT_FINITE
from bilevel.synthetic_env import Architecture, kernel_form
from bilevel.tasks import Task

#: One thread: the products are small, the cores belong to other evaluations, and
#: sums in a fixed order keep results the same everywhere.
_BLAS = ThreadpoolController()


@dataclass(frozen=True)
class EvaluationRequest:
    """What one evaluation needs besides task, architecture and psi.

    The agent trains on the SE psi + sign * eps, eps drawn from `perturbation_seed`;
    sign 0 is psi itself. A `start_seed` replaces psi by a fresh initialisation.
    """

    index: int  # position in the generation
    seed: int  # of agent, exploration, minibatches and test episodes
    agent: DDQNHyperparameters
    sign: int = 0
    perturbation_seed: int = 0
    std_dev: float = 0.0
    start_seed: int | None = None


@dataclass(frozen=True)
class EvaluationResult:
    """What came of it. `seconds` is the only field that is not determined by the
    request."""

    index: int
    score: float  # mean return of the test episodes on the real task
    train_steps: int
    train_episodes: int
    finite: bool  # False: numbers diverged; the score is the task's worst
    seconds: float


def evaluate(
    task: Task,
    architecture: Architecture,
    psi: NDArray[np.float32] | None,
    request: EvaluationRequest,
) -> EvaluationResult:
    """TrainAgent, then EvaluateAgent (paper, Algorithm 1).

    `psi` (P,) float32 may be None if the request brings a start seed.
    """
    started = time.perf_counter()
    se = request_psi(architecture, psi, request)
    outcome = train_and_test(task, (architecture, se), request.agent, request.seed)
    return EvaluationResult(request.index, *outcome, time.perf_counter() - started)


def request_psi(
    architecture: Architecture, psi: NDArray[np.float32] | None, request: EvaluationRequest
) -> NDArray[np.float32]:
    """The SE parameters (P,) that a request asks for."""
    if request.start_seed is not None:
        return architecture.initialize(np.random.default_rng(request.start_seed))
    assert psi is not None
    if request.sign == 0:
        return psi
    eps = architecture.perturbation(request.perturbation_seed, request.std_dev)
    return psi + np.float32(request.sign) * eps


def train_and_test(
    task: Task,
    se: tuple[Architecture, NDArray[np.float32]] | None,
    hp: DDQNHyperparameters,
    seed: int,
) -> tuple[float, int, int, bool]:
    """Train a fresh agent on an SE, or, without one, on the real task itself, and
    test it on the real task; returns score, train steps, train episodes and
    whether all numbers stayed finite.

    Raises ValueError for training on a real task whose dynamics are not compiled.
    """
    if se is None and not task.compiled:
        raise ValueError(f"{task.id} has no compiled dynamics to train on")
    init_seed, loop_seed, physics_seed, test_seed = np.random.SeedSequence(seed).generate_state(
        4, np.uint64
    )
    net = mlp.network(
        task.state_size, hp.hidden_size, hp.hidden_layers, task.n_actions, hp.activation
    )
    theta = mlp.initial_parameters(net, np.random.default_rng(init_seed))
    learner = ddqn.new_learner(net, theta, hp.batch_size)
    architecture, psi = se if se is not None else _NO_SE
    test_rng = np.random.default_rng(test_seed)

    def environment(physics: NDArray[np.float64]) -> ddqn.Environment:
        return ddqn.Environment(
            se is not None,
            kernel_form(architecture, psi),
            task.dynamics,
            task.state_size,
            task.step_limit,
            task.solved_reward,
            physics,
        )

    physics = task.initial_physics(np.random.default_rng(physics_seed), hp.max_episodes)
    tests = hp.test_episodes if se is not None else hp.test_episodes * (hp.max_episodes + 1)
    test_environment = environment(
        task.initial_physics(test_rng, tests) if task.compiled else physics
    )
    with _BLAS.limit(limits=1, user_api="blas"):
        steps, episodes, outcome = ddqn.train(
            learner,
            environment(physics),
            test_environment,
            settings(hp),
            np.array([loop_seed], np.uint64),
        )
        if outcome == NOT_FINITE or not np.isfinite(learner.theta).all():
            return task.worst_score, steps, episodes, False
        if task.compiled:
            returns = ddqn.test_returns(
                net, learner.theta, test_environment, tests - hp.test_episodes, hp.test_episodes
            )
        else:
            returns = _test_with_gymnasium(task, net, learner.theta, hp.test_episodes, test_rng)
    return float(returns.mean()), steps, episodes, True


#: Stands where the kernel expects an SE and reads none.
_SMALLEST = Architecture(1, 1, 1, 1, "tanh")
_NO_SE = (_SMALLEST, np.zeros(_SMALLEST.parameter_count, np.float32))


def settings(hp: DDQNHyperparameters) -> ddqn.Settings:
    """The hyperparameters as the kernel takes them."""
    return ddqn.Settings(**{name: getattr(hp, name) for name in ddqn.Settings._fields})


def _test_with_gymnasium(
    task: Task,
    net: mlp.Network,
    theta: NDArray[np.float32],
    episodes: int,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    work = np.zeros((2, int(net.sizes[1])), np.float32)
    q = np.zeros(task.n_actions, np.float32)

    def policy(state: NDArray[np.float32]) -> int:
        return int(ddqn.greedy_action(net, theta, state, work, q))

    return task.test_returns(policy, episodes, int(rng.integers(2**31)))
