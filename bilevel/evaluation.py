"""One evaluation: train a fresh agent on an SE, score it on the real task.

An evaluation is a pure function of its request, the task and the SEs: the same request gives the
same score wherever and whenever it runs. So a pool of actors may run requests in any order, and
repeat them.
"""

import time
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel.agents import Agent, get_agent
from bilevel.agents.agent import Transition, agent_seeds
from bilevel.agents.checked import CheckedAgent
from bilevel.agents.environments import GymnasiumEnvironment, KernelEnvironment
from bilevel.agents.training import TrainingEnvironment, returns_converged, task_solved
from bilevel.agents.training import train as train_in_python
from bilevel.cost import estimated_core_seconds
from bilevel.errors import InvalidInput
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.kernels import training
from bilevel.kernels.blas import one_blas_thread
from bilevel.kernels.environment import Environment, environment
from bilevel.kernels.stopping import NOT_FINITE
from bilevel.seeds import split
from bilevel.synthetic_env import SE, Architecture, SEDistribution, StoredSE
from bilevel.tasks import Task


@dataclass(frozen=True)
class Centre:
    """Train on the centre of the search distribution, or on a single given SE."""


@dataclass(frozen=True)
class Perturbed:
    """Train on centre + sign * eps, with eps drawn by `seed`."""

    seed: int
    sign: int  #: 1 or -1


@dataclass(frozen=True)
class Initialized:
    """Train on a random SE, drawn by `seed`."""

    seed: int


@dataclass(frozen=True)
class Given:
    """Train on one of several given SEs."""

    number: int


@dataclass(frozen=True)
class RealTask:
    """Train on the real task, without an SE."""


#: What an agent trains on.
TrainedOn = Centre | Perturbed | Initialized | Given | RealTask

#: What requests get their SE from: one SE, several, or a distribution; None for the real task.
SESource = SE | StoredSE | SEDistribution | tuple[SE, ...] | None


@dataclass(frozen=True)
class EvaluationRequest:
    """Input of one evaluation, besides the task and the SE or the distribution of SEs."""

    index: int  #: position among the requests of one call
    seed: int  #: of initial parameters, exploration, minibatches and test episodes
    agent: AgentHyperparameters
    on: TrainedOn = Centre()


@dataclass(frozen=True)
class Outcome:
    """Result of training and testing one fresh agent."""

    test_returns: tuple[float, ...]  #: of the test episodes on the real task
    train_steps: int
    train_episodes: int
    real_env_steps: int  #: of tests, and of training on the real task
    finite: bool  #: False: training or test diverged; the returns are the task's worst
    cost: float  #: core seconds, estimated (`bilevel.cost`)

    @property
    def score(self) -> float:
        """Mean return of the test episodes on the real task."""
        return float(np.mean(self.test_returns))


@dataclass(frozen=True)
class EvaluationResult(Outcome):
    """The outcome of the request `index`; only the measured `seconds` are not determined by it."""

    index: int
    seconds: float


def evaluate(task: Task, se: SESource, request: EvaluationRequest) -> EvaluationResult:
    """TrainAgent, then EvaluateAgent (paper, Algorithm 1).

    `se` is one SE (also as `load` and `learn` return it), for requests on `Centre`, several of
    them, for requests on `Given`, or a distribution that the request draws its SE from; it may be
    None for training on the real task.
    Raises InvalidInput for a request that `se` cannot serve, and for an SE of a task with other
    sizes.
    """
    started = time.perf_counter()
    outcome = train_and_test(task, requested_se(se, request.on), request.agent, request.seed)
    seconds = time.perf_counter() - started
    return EvaluationResult(**vars(outcome), index=request.index, seconds=seconds)


def requested_se(se: SESource, on: TrainedOn) -> SE | None:
    """The SE that a request asks for, None for the real task. Raises InvalidInput if `se` does not
    hold it."""
    if isinstance(on, RealTask):
        return None
    if isinstance(se, StoredSE):
        se = se.se
    if isinstance(on, Given) and isinstance(se, tuple):
        return se[on.number]
    if isinstance(se, SE) and isinstance(on, Centre):
        return se
    if not isinstance(se, SEDistribution) or isinstance(on, Given):
        raise InvalidInput(f"training on {on} needs another source of SEs; got {se!r:.40}")
    if isinstance(on, Perturbed):
        return se.perturbed(on.seed, on.sign)
    if isinstance(on, Initialized):
        return se.random(on.seed)
    return se.centre


def train_and_test(
    task: Task, se: SE | None, hp: AgentHyperparameters, seed: int, compiled: bool = True
) -> Outcome:
    """Train a fresh agent on `se` (None: on the real task) and test it on the real task.

    Unless `compiled` is False, the agent's compiled twin runs, if both the agent and the
    environment it trains on are compiled. Raises InvalidInput for an SE of a task with other sizes,
    and AgentMistake for an agent in Python that returns what it must not, raises or exits.
    """
    if se is not None:
        se.architecture.check_fits(task)
    agent_seed, physics_seed, test_seed = split(seed, 3)
    run = _Run(task, se, hp, agent_seed, physics_seed, test_seed)
    has_kernel = get_agent(hp.agent).build_kernel is not None
    with one_blas_thread():
        if compiled and has_kernel and (se is not None or task.compiled):
            return run.compiled()
        return run.interpreted()


#: Placeholder where the kernel takes an SE but does not read it.
_SMALLEST = Architecture(1, 1, 1, 1, "tanh", 1)
_NO_SE = SE(_SMALLEST, np.zeros(_SMALLEST.parameter_count, np.float32))


def real_returns(
    task: Task, agent: Any, episodes: int, seed: int
) -> tuple[NDArray[np.float64], int]:
    """Returns (episodes,) of greedy episodes of a compiled agent on the real task, and their
    number of steps."""
    if task.compiled:
        returns, steps = training.test_returns(
            agent, _environment(task, None, episodes, seed), episodes
        )
        return returns, int(steps)
    return task.test_returns(
        lambda state: int(training.greedy_action(agent, state)), episodes, seed % 2**31
    )


def _environment(task: Task, se: SE | None, episodes: int, seed: int) -> Environment:
    """The SE, or (None) the compiled real task, with initial states of `episodes` episodes."""
    return environment(
        (se or _NO_SE).kernel,
        se is not None,
        task.dynamics,
        task.state_size,
        task.step_limit if se is None else se.architecture.step_limit,
        task.solved_reward,
        task.initial_physics(np.random.default_rng(seed), episodes),
    )


@dataclass(frozen=True)
class _Run:
    """One training run and its tests."""

    task: Task
    se: SE | None
    hp: AgentHyperparameters
    agent_seed: int
    physics_seed: int
    test_seed: int

    def _training_environment(self) -> Environment:
        return _environment(self.task, self.se, self.hp.max_episodes, self.physics_seed)

    def compiled(self) -> Outcome:
        """Train and test the agent's compiled kernel."""
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
        returns, tested = real_returns(task, agent, hp.test_episodes, self.test_seed)
        if not np.isfinite(returns).all():
            return self._diverged(steps, episodes, tested)
        real = tested + self._real_steps(steps)
        return self._outcome(tuple(returns.tolist()), steps, episodes, real, True)

    def _real_steps(self, train_steps: int) -> int:
        """Steps of the training that were made on the real task."""
        return train_steps if self.se is None else 0

    def interpreted(self) -> Outcome:
        """Train and test the agent's definition: slower, but works for every agent and task."""
        import torch

        threads = torch.get_num_threads()
        torch.set_num_threads(1)  # other evaluations use the other cores
        try:
            return self._interpreted()
        finally:
            torch.set_num_threads(threads)

    def _interpreted(self) -> Outcome:
        task, hp = self.task, self.hp
        build = partial(
            get_agent(hp.agent).build, hp, task.state_size, task.n_actions, self.agent_seed
        )
        agent = CheckedAgent(hp.agent, task.n_actions, build)
        env: TrainingEnvironment
        if self.se is not None or task.compiled:
            env = KernelEnvironment(self._training_environment())
        else:
            env = GymnasiumEnvironment(task, self.physics_seed % 2**31)
        stop = returns_converged(hp) if self.se else task_solved(hp, task.solved_reward)
        steps, episodes, finite = train_in_python(agent, hp, env, stop)
        if not finite:
            return self._diverged(steps, episodes)
        returns, tested = self._tested(agent)
        if not np.isfinite(returns).all():
            return self._diverged(steps, episodes, tested)
        return self._outcome(returns, steps, episodes, tested + self._real_steps(steps), True)

    def _tested(self, agent: Agent) -> tuple[tuple[float, ...], int]:
        """EvaluateAgent for an agent in Python: returns and number of steps of greedy episodes."""
        n = self.hp.test_episodes
        if not self.task.compiled:
            returns, made = self.task.test_returns(agent.greedy, n, self.test_seed % 2**31)
            return tuple(returns.tolist()), made
        environment = _environment(self.task, None, n, self.test_seed)
        env, totals, made = KernelEnvironment(environment), [0.0] * n, 0
        for episode in range(n):
            state = env.reset(episode)
            for _ in range(env.step_limit):
                state, reward, done = env.step(agent.greedy(state))
                totals[episode] += reward
                made += 1
                if done > 0.5:
                    break
        return tuple(totals), made

    def _diverged(self, steps: int, episodes: int, tested: int = 0) -> Outcome:
        worst = (self.task.worst_score,) * self.hp.test_episodes
        return self._outcome(worst, steps, episodes, tested + self._real_steps(steps), False)

    def _outcome(
        self, returns: tuple[float, ...], steps: int, episodes: int, real: int, finite: bool
    ) -> Outcome:
        cost = estimated_core_seconds(self.hp, steps, real)
        return Outcome(returns, steps, episodes, real, finite, cost)


def record(
    task: Task, se: SE, hp: AgentHyperparameters, seed: int
) -> tuple[list[Transition], list[Transition]]:
    """Transitions of the training on `se` and of the tests on the real task that `train_and_test`
    makes with these arguments, by the agent's definition; no tests if training diverges."""
    import torch

    agent_seed, physics_seed, test_seed = split(seed, 3)
    build = partial(get_agent(hp.agent).build, hp, task.state_size, task.n_actions, agent_seed)
    agent = _Recorder(CheckedAgent(hp.agent, task.n_actions, build))
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        training_env = KernelEnvironment(_environment(task, se, hp.max_episodes, physics_seed))
        _, _, finite = train_in_python(agent, hp, training_env, returns_converged(hp))
        tests = _test_transitions(task, agent, hp.test_episodes, test_seed) if finite else []
    finally:
        torch.set_num_threads(threads)
    return agent.observed, tests


class _Recorder:
    """An agent that keeps what it observes."""

    def __init__(self, agent: Agent) -> None:
        self.act, self.greedy = agent.act, agent.greedy
        self.learn, self.end_episode = agent.learn, agent.end_episode
        self._observe = agent.observe
        self.observed: list[Transition] = []

    def observe(self, transition: Transition) -> None:
        """See `Agent`."""
        self.observed.append(transition)
        self._observe(transition)


def _test_transitions(task: Task, agent: Agent, episodes: int, seed: int) -> list[Transition]:
    env: TrainingEnvironment = (
        KernelEnvironment(_environment(task, None, episodes, seed))
        if task.compiled
        else GymnasiumEnvironment(task, seed % 2**31)
    )
    made: list[Transition] = []
    for episode in range(episodes):
        state = env.reset(episode)
        for _ in range(env.step_limit):
            action = agent.greedy(state)
            next_state, reward, done = env.step(action)
            made.append(Transition(state, action, reward, next_state, done))
            state = next_state
            if done > 0.5:
                break
    return made


def schedule(hp: AgentHyperparameters) -> training.Schedule:
    """An agent's training length, in the form of the compiled loop."""
    return training.Schedule(
        hp.init_episodes,
        hp.max_episodes,
        hp.early_out_episodes,
        hp.early_out_difference,
        getattr(hp, "replay_capacity", 1),
    )
