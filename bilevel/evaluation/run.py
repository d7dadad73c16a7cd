"""TrainAgent and EvaluateAgent (paper, Algorithm 1): one agent's training and its tests."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bilevel.agents import get_agent
from bilevel.agents.agent import Transition, agent_seeds
from bilevel.agents.checked import CheckedAgent
from bilevel.agents.environments import GymnasiumEnvironment, KernelEnvironment
from bilevel.agents.training import TrainingEnvironment, returns_converged, task_solved
from bilevel.agents.training import train as train_in_python
from bilevel.cost import estimated_core_seconds
from bilevel.errors import require
from bilevel.evaluation.recording import RecordedAgent, Recording
from bilevel.evaluation.requests import (
    EvaluationRequest,
    EvaluationResult,
    Outcome,
    SESource,
    requested_se,
)
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.kernels import training
from bilevel.kernels.environment import Environment, environment
from bilevel.kernels.stopping import NOT_FINITE
from bilevel.seeds import checked_seed, split
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task
from bilevel.threads import one_blas_thread, one_torch_thread


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


def train_and_test(
    task: Task, se: SE | None, hp: AgentHyperparameters, seed: int, compiled: bool = True
) -> Outcome:
    """Train a fresh agent on `se` (None: on the real task) and test it on the real task.

    Unless `compiled` is False, the agent's compiled twin runs, if both the agent and the
    environment it trains on are compiled. Raises InvalidInput for an SE of a task with other sizes,
    and Mistake for an agent in Python, or a task, that returns what it must not, raises or exits.
    """
    run = AgentRun.of(task, se, hp, seed)
    has_kernel = get_agent(hp.agent).build_kernel is not None
    with one_blas_thread():
        if compiled and has_kernel and (se is not None or task.compiled):
            return run.compiled()
        return run.interpreted()


def record(task: Task, se: SE, hp: AgentHyperparameters, seed: int) -> Recording:
    """The transitions that `train_and_test` makes with these arguments, by the agent's definition;
    no tests if training diverges. Raises InvalidInput for an SE of a task with other sizes."""
    recording = Recording()
    AgentRun.of(task, se, hp, seed).interpreted(recording)
    return recording


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
        with closing(GymnasiumEnvironment(task, seed)) as env:
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
class AgentRun:
    """One agent's training and tests, with its seeds."""

    task: Task
    se: SE | None
    hp: AgentHyperparameters
    agent_seed: int
    physics_seed: int
    test_seed: int

    @classmethod
    def of(cls, task: Task, se: SE | None, hp: AgentHyperparameters, seed: int) -> Self:
        """Raises InvalidInput for an SE of a task with other sizes."""
        if se is not None:
            se.architecture.check_fits(task)
        return cls(task, se, hp, *split(seed, 3))

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

    def interpreted(self, recording: Recording | None = None) -> Outcome:
        """Train and test the agent's definition: slower, but works for every agent and task."""
        task, hp = self.task, self.hp
        with one_torch_thread():  # other evaluations use the other cores
            agent = definition(task, hp, self.agent_seed, recording)
            stop = returns_converged(hp) if self.se else task_solved(hp, task.solved_reward)
            with environment_in_python(task, self.se, hp.max_episodes, self.physics_seed) as env:
                steps, episodes, finite = train_in_python(agent, hp, env, stop)
            if not finite:
                return self._diverged(steps, episodes)
            tests = greedy_episodes(task, agent.greedy, hp.test_episodes, self.test_seed)
            returns, tested = _returns(tests if recording is None else recording.keeping(tests))
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


def definition(
    task: Task, hp: AgentHyperparameters, agent_seed: int, recording: Recording | None = None
) -> CheckedAgent:
    """A fresh agent in Python. Raises Mistake where it returns what it must not, raises or
    exits."""
    build = partial(get_agent(hp.agent).build, hp, task.state_size, task.n_actions, agent_seed)
    if recording is None:
        return CheckedAgent(hp.agent, task.n_actions, build)
    return RecordedAgent(hp.agent, task.n_actions, build, recording.training)


def schedule(hp: AgentHyperparameters) -> training.Schedule:
    """An agent's training length, in the form of the compiled loop."""
    return training.Schedule(
        hp.init_episodes,
        hp.max_episodes,
        hp.early_out_episodes,
        hp.early_out_difference,
        getattr(hp, "replay_capacity", 1),
    )
