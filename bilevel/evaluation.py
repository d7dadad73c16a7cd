"""One evaluation: train a fresh agent on an SE, score it on the real task.

An evaluation is a pure function of its request, the task and the SEs: the same request gives the
same score wherever and whenever it runs. So a pool of actors may run requests in any order, and
repeat them.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bilevel.agents import get_agent
from bilevel.agents.agent import Transition, agent_seeds
from bilevel.agents.checked import CheckedAgent
from bilevel.agents.environments import GymnasiumEnvironment, KernelEnvironment
from bilevel.agents.training import TrainingEnvironment, returns_converged, task_solved
from bilevel.agents.training import train as train_in_python
from bilevel.cost import estimated_core_seconds
from bilevel.errors import InvalidInput, require
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.kernels import training
from bilevel.kernels.environment import Environment, environment
from bilevel.kernels.stopping import NOT_FINITE
from bilevel.seeds import checked_seed, split
from bilevel.synthetic_env import SE, Architecture, SEDistribution, StoredSE
from bilevel.tasks import Task
from bilevel.threads import one_blas_thread, one_torch_thread


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

    number: int  #: of the SE, from 0


@dataclass(frozen=True)
class RealTask:
    """Train on the real task, without an SE."""


#: What an agent trains on.
TrainedOn = Centre | Perturbed | Initialized | Given | RealTask

#: What requests get their SE from: one SE, several, or a distribution; None for the real task.
SESource = SE | StoredSE | SEDistribution | tuple[SE | StoredSE, ...] | None


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


_Result = TypeVar("_Result", bound=Outcome)


def comparable(results: Sequence[_Result]) -> list[_Result]:
    """The results with test returns by which they can be compared. A diverged agent gets no more
    than the lowest score of the others, however the task's worst score compares with them."""
    lowest = min((result.score for result in results if result.finite), default=np.inf)
    return [
        result
        if result.finite
        else replace(result, test_returns=tuple(min(one, lowest) for one in result.test_returns))
        for result in results
    ]


def scores_of(results: Sequence[Outcome]) -> NDArray[np.float64]:
    """Scores (n,) of `comparable` results."""
    return np.array([result.score for result in comparable(results)])


def evaluate(task: Task, se: SESource, request: EvaluationRequest) -> EvaluationResult:
    """TrainAgent, then EvaluateAgent (paper, Algorithm 1).

    `se` is one SE (also as `load` and `learn` return it), for requests on `Centre`, several of
    them, for requests on `Given`, or a distribution that the request draws its SE from; it may be
    None for training on the real task.
    Raises InvalidInput for a request that `se` cannot serve, for a seed that is no integer of at
    least 0, and for an SE of a task with other sizes.
    """
    started = time.perf_counter()
    require(Task, task, "the task of an evaluation", "as bilevel.get_task returns it")
    require(
        AgentHyperparameters, request.agent, "the agent of a request", "one of a recipe's agents"
    )
    seed = checked_seed(request.seed)
    outcome = train_and_test(task, requested_se(se, request.on), request.agent, seed)
    seconds = time.perf_counter() - started
    return EvaluationResult(**vars(outcome), index=request.index, seconds=seconds)


def requested_se(se: SESource, on: TrainedOn) -> SE | None:
    """The SE that a request asks for, None for the real task. Raises InvalidInput if `se` does not
    hold it."""
    if isinstance(on, RealTask):
        return None
    if isinstance(on, Given) and isinstance(se, tuple):
        if not 0 <= on.number < len(se):
            raise InvalidInput(f"training on {on}: allowed are the SEs 0 to {len(se) - 1}")
        se, on = se[on.number], Centre()
    if isinstance(se, StoredSE):
        se = se.se
    if isinstance(se, SE) and isinstance(on, Centre):
        return se
    if not isinstance(se, SEDistribution) or isinstance(on, Given):
        needed = {Centre: "an SE or a distribution of SEs", Given: "a tuple of SEs"}
        raise InvalidInput(
            f"training on {on} needs {needed.get(type(on), 'a distribution of SEs')} (on the real "
            f"task, on=RealTask() needs none); got {se!r:.40}"
        )
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
    and Mistake for an agent in Python, or a task, that returns what it must not, raises or exits.
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


def greedy_episodes(
    task: Task, greedy: Callable[[NDArray[np.float32]], int], episodes: int, seed: int
) -> Iterator[list[Transition]]:
    """EvaluateAgent (paper, Algorithm 1) for an agent in Python: the transitions of each test
    episode on the real task."""
    with environment_in_python(task, None, episodes, seed) as env:
        for episode in range(episodes):
            state, over, made = env.reset(episode), False, list[Transition]()
            while not over and len(made) < env.step_limit:
                action = greedy(state)
                next_state, reward, done, over = env.step(action)
                made.append(Transition(state, action, reward, next_state, done))
                state = next_state
            yield made


def real_returns(
    task: Task, agent: Any, episodes: int, seed: int
) -> tuple[NDArray[np.float64], int]:
    """Returns (episodes,) of greedy episodes of a compiled agent on the real task, and their
    number of steps."""
    if task.compiled:
        environment = _environment(task, None, episodes, seed)
        returns, steps = training.test_returns(agent, environment, episodes)
        return returns, int(steps)

    def greedy(state: NDArray[np.float32]) -> int:
        return int(training.greedy_action(agent, state))

    return _returns(greedy_episodes(task, greedy, episodes, seed))


def _returns(episodes: Iterator[list[Transition]]) -> tuple[NDArray[np.float64], int]:
    returns, steps = [], 0
    for transitions in episodes:
        returns.append(sum(transition.reward for transition in transitions))
        steps += len(transitions)
    return np.array(returns, np.float64), steps


@contextmanager
def environment_in_python(
    task: Task, se: SE | None, episodes: int, seed: int
) -> Iterator[TrainingEnvironment]:
    """The SE, or (None) the real task, with initial states of `episodes` episodes, for agents in
    Python, as a context that closes it."""
    if se is None and not task.compiled:
        with closing(GymnasiumEnvironment(task, seed % 2**31)) as env:
            yield env
    else:
        yield KernelEnvironment(_environment(task, se, episodes, seed))


#: Placeholder where the kernel takes an SE but does not read it.
_SMALLEST = Architecture(1, 1, 1, 1, "tanh", 1)
_NO_SE = SE(_SMALLEST, np.zeros(_SMALLEST.parameter_count, np.float32))


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

    def compiled(self) -> Outcome:
        """Train and test the agent's compiled kernel."""
        task, hp, registered = self.task, self.hp, get_agent(self.hp.agent)
        assert registered.build_kernel is not None
        assert registered.kernel_parameters is not None
        initial, loop = agent_seeds(self.agent_seed)
        agent = registered.build_kernel(
            hp, task.state_size, task.n_actions, np.random.default_rng(initial)
        )
        env = _environment(task, self.se, hp.max_episodes, self.physics_seed)
        rng = np.array([loop], np.uint64)
        steps, episodes, reason = training.train(agent, env, schedule(hp), rng)
        parameters = registered.kernel_parameters(agent)
        if reason == NOT_FINITE or not all(np.isfinite(p).all() for p in parameters):
            return self._diverged(steps, episodes)
        returns, tested = real_returns(task, agent, hp.test_episodes, self.test_seed)
        return self._tested(steps, episodes, returns, tested)

    def interpreted(self) -> Outcome:
        """Train and test the agent's definition: slower, but works for every agent and task."""
        task, hp, n = self.task, self.hp, self.hp.test_episodes
        with one_torch_thread():  # other evaluations use the other cores
            agent = definition(task, hp, self.agent_seed)
            stop = returns_converged(hp) if self.se else task_solved(hp, task.solved_reward)
            with environment_in_python(task, self.se, hp.max_episodes, self.physics_seed) as env:
                steps, episodes, finite = train_in_python(agent, hp, env, stop)
            if not finite:
                return self._diverged(steps, episodes)
            returns, tested = _returns(greedy_episodes(task, agent.greedy, n, self.test_seed))
        return self._tested(steps, episodes, returns, tested)

    def _tested(
        self, steps: int, episodes: int, returns: NDArray[np.float64], tested: int
    ) -> Outcome:
        """The outcome with the returns of tests that took `tested` steps."""
        if not np.isfinite(returns).all():
            return self._diverged(steps, episodes, tested)
        return self._outcome(tuple(returns.tolist()), steps, episodes, tested, True)

    def _diverged(self, steps: int, episodes: int, tested: int = 0) -> Outcome:
        worst = (self.task.worst_score,) * self.hp.test_episodes
        return self._outcome(worst, steps, episodes, tested, False)

    def _outcome(
        self, returns: tuple[float, ...], steps: int, episodes: int, tested: int, finite: bool
    ) -> Outcome:
        real = tested + (steps if self.se is None else 0)
        cost = estimated_core_seconds(self.hp, steps, real)
        return Outcome(returns, steps, episodes, real, finite, cost)


def definition(task: Task, hp: AgentHyperparameters, agent_seed: int) -> CheckedAgent:
    """A fresh agent in Python. Raises Mistake where it returns what it must not, raises or
    exits."""
    build = partial(get_agent(hp.agent).build, hp, task.state_size, task.n_actions, agent_seed)
    return CheckedAgent(hp.agent, task.n_actions, build)


def schedule(hp: AgentHyperparameters) -> training.Schedule:
    """An agent's training length, in the form of the compiled loop."""
    return training.Schedule(
        hp.init_episodes,
        hp.max_episodes,
        hp.early_out_episodes,
        hp.early_out_difference,
        getattr(hp, "replay_capacity", 1),
    )
