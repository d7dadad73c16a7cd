"""TrainAgent and EvaluateAgent (paper, Algorithm 1): one agent's training and its tests."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bilevel.agents import Transition, get_agent
from bilevel.agents.agent import agent_seeds
from bilevel.agents.environments import compiled_environment, environment_in_python
from bilevel.agents.training import Record, ignore, returns_converged, task_solved
from bilevel.agents.training import train as train_in_python
from bilevel.errors import require
from bilevel.evaluation.requests import (
    EvaluationRequest,
    EvaluationResult,
    SESource,
    requested_se,
)
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.kernels import training
from bilevel.seeds import checked_seed, split
from bilevel.spaces import Action
from bilevel.synthetic_env import SE
from bilevel.tasks import Task
from bilevel.threads import one_blas_thread, one_torch_thread
from bilevel.user_code import user_code_errors

#: Returns (episodes,) of tests, and their number of steps.
_Tests = tuple[NDArray[np.float64], int]


def evaluate(task: Task, se: SESource, request: EvaluationRequest) -> EvaluationResult:
    """TrainAgent, then EvaluateAgent (paper, Algorithm 1).

    `se` is the source of the request's SE: one SE (also as `load` and `learn` return it) for
    `Centre`, a tuple of SEs for `Given`, a distribution, or None for training on the real task.
    Raises InvalidInput for an invalid seed and an SE that is missing or does not fit the task.
    """
    started = time.perf_counter()
    require(Task, task, "the task of an evaluation", "as bilevel.get_task returns it")
    seed = checked_seed(request.seed)
    result = train_and_test(task, requested_se(se, request.on), request.agent, seed)
    return replace(result, index=request.index, seconds=time.perf_counter() - started)


def train_and_test(
    task: Task, se: SE | None, hp: AgentHyperparameters, seed: int, compiled: bool = True
) -> EvaluationResult:
    """Train a fresh agent on `se` (None: on the real task) and test it on the real task, by its
    compiled twin if possible and `compiled`.

    Raises InvalidInput for an SE of a task with other sizes and for an agent without the task's
    kind of actions, and UserCodeError for a user's agent or task that raises, exits or returns a
    wrong value.
    """
    has_kernel = get_agent(hp.agent, task.continuous).build_kernel is not None
    with one_blas_thread():
        if compiled and has_kernel and (se is not None or task.compiled):
            return _run_kernel(task, se, hp, seed)
        return _run_definition(task, se, hp, seed)


def record(
    task: Task, se: SE, hp: AgentHyperparameters, seed: int
) -> tuple[list[Transition], list[Transition]]:
    """The transitions of training and of tests (none if training diverges) in `train_and_test`, by
    the agent's definition. Raises InvalidInput for an SE of a task with other sizes."""
    trained, tested = list[Transition](), list[Transition]()
    _run_definition(task, se, hp, seed, trained.append, tested.append)
    return trained, tested


def _run_kernel(task: Task, se: SE | None, hp: AgentHyperparameters, seed: int) -> EvaluationResult:
    """Train and test the compiled twin of an agent."""
    agent_seed, physics_seed, test_seed = split(seed, 3)
    initial, loop = agent_seeds(agent_seed)
    build = get_agent(hp.agent, task.continuous).build_kernel
    assert build is not None
    agent = build(hp, task.state_size, task.action_size, np.random.default_rng(initial))
    env = compiled_environment(task, se, hp.max_episodes, physics_seed)
    rng = np.array([loop], np.uint64)
    steps, episodes, reason = training.train(agent, env, schedule(hp), rng)
    finite = reason != training.NOT_FINITE and all(np.isfinite(p).all() for p in agent.parameters())
    tests = _test_kernel(task, agent, hp.test_episodes, test_seed) if finite else None
    return _result(task, se, hp, steps, episodes, tests)


def _run_definition(
    task: Task,
    se: SE | None,
    hp: AgentHyperparameters,
    seed: int,
    on_training: Record = ignore,
    on_test: Record = ignore,
) -> EvaluationResult:
    """Train and test the definition of an agent, and pass the transitions to two callbacks."""
    agent_seed, physics_seed, test_seed = split(seed, 3)
    build = get_agent(hp.agent, task.continuous).build
    stop = task_solved(hp, task.solved_reward) if se is None else returns_converged(hp)
    tests = None
    with (
        one_torch_thread(),
        environment_in_python(task, se, hp.max_episodes, physics_seed) as env,
        user_code_errors(f"agent {hp.agent!r}", "runs"),
    ):
        agent = build(hp, task.state_size, task.action_size, agent_seed)
        steps, episodes, finite = train_in_python(agent, hp, env, stop, on_training)
        if finite:
            greedy = greedy_episodes(task, agent.greedy, hp.test_episodes, test_seed)
            tests = _returns(greedy, on_test)
    return _result(task, se, hp, steps, episodes, tests)


def _result(
    task: Task,
    se: SE | None,
    hp: AgentHyperparameters,
    steps: int,
    episodes: int,
    tests: _Tests | None,
) -> EvaluationResult:
    """The result of a training that diverged (tests: None), or of an agent with these tests."""
    returns, real_steps = tests or (np.full(hp.test_episodes, np.nan), 0)
    finite = bool(np.isfinite(returns).all())
    if not finite:
        returns = np.full(hp.test_episodes, task.worst_score)
    if se is None:
        real_steps += steps
    cost = hp.core_seconds(steps) + task.step_seconds * real_steps
    return EvaluationResult(tuple(returns.tolist()), steps, episodes, real_steps, finite, cost)


def greedy_episodes(
    task: Task, greedy: Callable[[NDArray[np.float32]], Action], episodes: int, seed: int
) -> Iterator[list[Transition]]:
    """EvaluateAgent (paper, Algorithm 1) in Python: the transitions of each test episode."""
    with environment_in_python(task, None, episodes, seed) as env:
        for episode in range(episodes):
            state, over, transitions = env.reset(episode), False, list[Transition]()
            while not over and len(transitions) < env.step_limit:
                action = greedy(state)
                next_state, reward, done, over = env.step(action)
                transitions.append(Transition(state, action, reward, next_state, done))
                state = next_state
            yield transitions


def _test_kernel(task: Task, agent: training.Kernel, episodes: int, seed: int) -> _Tests:
    """EvaluateAgent for a compiled agent."""
    if not task.compiled:
        greedy = partial(training.greedy_action, agent)
        return _returns(greedy_episodes(task, greedy, episodes, seed))
    env = compiled_environment(task, None, episodes, seed)
    returns, steps = training.test_returns(agent, env, episodes)
    return returns, int(steps)


def _returns(episodes: Iterable[list[Transition]], record: Record = ignore) -> _Tests:
    returns, steps = [], 0
    for transitions in episodes:
        returns.append(sum(transition.reward for transition in transitions))
        steps += len(transitions)
        for transition in transitions:
            record(transition)
    return np.array(returns, np.float64), steps


def schedule(hp: AgentHyperparameters) -> training.Schedule:
    """An agent's training length, in the form of the compiled loop."""
    # An agent without a replay buffer has no `replay_capacity`.
    return training.Schedule(*(getattr(hp, name, 1) for name in training.Schedule._fields))
