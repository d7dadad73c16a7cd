"""One evaluation: train a fresh agent on an SE, score it on the real task.

An evaluation is a pure function of its request (and of psi, task and
architecture): the same request gives the same score wherever and whenever it is
run, which is what lets a pool of actors run them in any order, and again.
"""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.agents import Agent, get_agent
from bilevel.agents.agent import agent_seeds
from bilevel.agents.environments import GymnasiumEnvironment, KernelEnvironment
from bilevel.agents.training import TrainingEnvironment, returns_converged, task_solved
from bilevel.agents.training import train as train_in_python
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.kernels import training
from bilevel.kernels.blas import one_blas_thread
from bilevel.kernels.environment import Environment, environment
from bilevel.kernels.stopping import NOT_FINITE
from bilevel.synthetic_env import Architecture, kernel_form
from bilevel.tasks import Task


@dataclass(frozen=True)
class EvaluationRequest:
    """What one evaluation needs besides task, architecture and psi.

    The agent trains on the SE psi + sign * eps, eps drawn from `perturbation_seed`;
    sign 0 is psi itself. `start_seed` replaces psi by a fresh initialisation; on the
    `real` task there is no SE at all.
    """

    index: int  # position in the generation
    seed: int  # of agent, exploration, minibatches and test episodes
    agent: AgentHyperparameters
    sign: int = 0
    perturbation_seed: int = 0
    std_dev: float = 0.0
    start_seed: int | None = None
    real: bool = False


@dataclass(frozen=True)
class Outcome:
    """What came of training a fresh agent and testing it."""

    test_returns: tuple[float, ...]  # of the test episodes on the real task
    train_steps: int
    train_episodes: int
    finite: bool  # False: numbers diverged; the returns are the task's worst


@dataclass(frozen=True)
class EvaluationResult(Outcome):
    """The outcome of a request. `seconds` is the only field that is not determined
    by the request."""

    index: int
    seconds: float

    @property
    def score(self) -> float:
        """Mean return of the test episodes on the real task."""
        return float(np.mean(self.test_returns))


def evaluate(
    task: Task,
    architecture: Architecture | None,
    psi: NDArray[np.float32] | None,
    request: EvaluationRequest,
) -> EvaluationResult:
    """TrainAgent, then EvaluateAgent (paper, Algorithm 1).

    `psi` (P,) float32 may be None if the request brings a start seed, or asks for
    training on the real task.
    """
    started = time.perf_counter()
    se = None
    if not request.real:
        assert architecture is not None
        se = (architecture, request_psi(architecture, psi, request))
    outcome = train_and_test(task, se, request.agent, request.seed)
    seconds = time.perf_counter() - started
    return EvaluationResult(**vars(outcome), index=request.index, seconds=seconds)


def request_psi(
    architecture: Architecture, psi: NDArray[np.float32] | None, request: EvaluationRequest
) -> NDArray[np.float32]:
    """The SE parameters (P,) that a request asks for."""
    if request.start_seed is not None:
        psi = architecture.initialize(np.random.default_rng(request.start_seed))
    assert psi is not None
    if request.sign == 0:
        return psi
    eps = architecture.perturbation(request.perturbation_seed, request.std_dev)
    return psi + np.float32(request.sign) * eps


SE = tuple[Architecture, NDArray[np.float32]]


def train_and_test(
    task: Task, se: SE | None, hp: AgentHyperparameters, seed: int, compiled: bool = True
) -> Outcome:
    """Train a fresh agent on an SE, or, without one, on the real task itself, and
    test it on the real task.

    The compiled twin of the agent is used where there is one (and the real task, if
    trained on, is compiled), unless `compiled` is False.
    """
    agent_seed, physics_seed, test_seed = (
        int(word) for word in np.random.SeedSequence(seed).generate_state(3, np.uint64)
    )
    run = _Run(task, se, hp, agent_seed, physics_seed, test_seed)
    has_kernel = get_agent(hp.agent).build_kernel is not None
    with one_blas_thread():
        if compiled and has_kernel and (se is not None or task.compiled):
            return run.compiled()
        return run.interpreted()


#: Stands where the kernel expects an SE and reads none.
_SMALLEST = Architecture(1, 1, 1, 1, "tanh")
_NO_SE = (_SMALLEST, np.zeros(_SMALLEST.parameter_count, np.float32))


def real_returns(task: Task, agent: Any, episodes: int, seed: int) -> NDArray[np.float64]:
    """Returns (episodes,) of greedy episodes of a compiled agent on the real task."""
    if task.compiled:
        returns: NDArray[np.float64] = training.test_returns(
            agent, _environment(task, None, episodes, seed), episodes
        )
        return returns
    return task.test_returns(
        lambda state: int(training.greedy_action(agent, state)), episodes, seed % 2**31
    )


def _environment(task: Task, se: SE | None, episodes: int, seed: int) -> Environment:
    """An SE, or the compiled real task, with the initial states of so many episodes."""
    architecture, psi = se or _NO_SE
    return environment(
        kernel_form(architecture, psi),
        se is not None,
        task.dynamics,
        task.state_size,
        task.step_limit if se is None else architecture.step_limit(task),
        task.solved_reward,
        task.initial_physics(np.random.default_rng(seed), episodes),
    )


@dataclass(frozen=True)
class _Run:
    """One training and its tests."""

    task: Task
    se: SE | None
    hp: AgentHyperparameters
    agent_seed: int
    physics_seed: int
    test_seed: int

    def _training_environment(self) -> Environment:
        return _environment(self.task, self.se, self.hp.max_episodes, self.physics_seed)

    def compiled(self) -> Outcome:
        """By the agent's kernel."""
        task, hp, registered = self.task, self.hp, get_agent(self.hp.agent)
        assert registered.build_kernel is not None
        assert registered.kernel_parameters is not None
        initial, loop = agent_seeds(self.agent_seed)
        agent = registered.build_kernel(
            hp, task.state_size, task.n_actions, np.random.default_rng(initial)
        )
        env = self._training_environment()
        rng = np.array([loop], np.uint64)
        steps, episodes, reason = training.train(agent, env, schedule(hp), rng)
        parameters = registered.kernel_parameters(agent)
        if reason == NOT_FINITE or not all(np.isfinite(p).all() for p in parameters):
            return self._diverged(steps, episodes)
        returns = real_returns(task, agent, hp.test_episodes, self.test_seed)
        return Outcome(tuple(returns.tolist()), steps, episodes, True)

    def interpreted(self) -> Outcome:
        """By the agent's definition: the same, slower, and for every agent and task."""
        import torch

        threads = torch.get_num_threads()
        torch.set_num_threads(1)  # the other cores belong to other evaluations
        try:
            return self._interpreted()
        finally:
            torch.set_num_threads(threads)

    def _interpreted(self) -> Outcome:
        task, hp = self.task, self.hp
        agent = get_agent(hp.agent).build(hp, task.state_size, task.n_actions, self.agent_seed)
        env: TrainingEnvironment
        if self.se is not None or task.compiled:
            env = KernelEnvironment(self._training_environment())
        else:
            env = GymnasiumEnvironment(task, self.physics_seed % 2**31)
        stop = returns_converged(hp) if self.se else task_solved(hp, task.solved_reward)
        steps, episodes, finite = train_in_python(agent, hp, env, stop)
        if not finite:
            return self._diverged(steps, episodes)
        return Outcome(self._tested(agent), steps, episodes, True)

    def _tested(self, agent: Agent) -> tuple[float, ...]:
        """EvaluateAgent for an agent in Python: the returns of greedy episodes."""
        n = self.hp.test_episodes
        if not self.task.compiled:
            returns = self.task.test_returns(agent.greedy, n, self.test_seed % 2**31)
            return tuple(returns.tolist())
        environment = _environment(self.task, None, n, self.test_seed)
        env, totals = KernelEnvironment(environment), [0.0] * n
        for episode in range(n):
            state = env.reset(episode)
            for _ in range(env.step_limit):
                state, reward, done = env.step(agent.greedy(state))
                totals[episode] += reward
                if done > 0.5:
                    break
        return tuple(totals)

    def _diverged(self, steps: int, episodes: int) -> Outcome:
        return Outcome((self.task.worst_score,) * self.hp.test_episodes, steps, episodes, False)


def schedule(hp: AgentHyperparameters) -> training.Schedule:
    """How long an agent trains, as the compiled loop takes it."""
    return training.Schedule(
        hp.init_episodes,
        hp.max_episodes,
        hp.early_out_episodes,
        hp.early_out_difference,
        getattr(hp, "replay_capacity", 1),
    )
