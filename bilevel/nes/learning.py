"""An NES run in one call, without Ray, MLflow or files."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from numbers import Integral
from pathlib import Path

import gymnasium
from gymnasium.envs.registration import EnvSpec

from bilevel.agents.agent import RegisteredAgent, get_agent, register_again
from bilevel.errors import InvalidInput, is_number, require
from bilevel.evaluation import EvaluationRequest, EvaluationResult, evaluate
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters
from bilevel.nes.algorithm import NES
from bilevel.nes.records import GenerationRecord
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SEDistribution, StoredSE
from bilevel.tasks import Task, get_task


def learn(
    task: Task | str,
    recipe: Hyperparameters | Path | str = "default",
    *,
    seed: int = 0,
    workers: int = 1,
    executor: Executor | None = None,
    on_generation: Callable[[GenerationRecord], None] | None = None,
) -> StoredSE:
    """Learn an SE for a task by NES, and return the best one.

    `recipe` is a recipe's name or file, or hyperparameters. Evaluations run in this process, in
    `workers` processes, or on `executor`, which stays open and whose processes must know the task
    and the agents. The SE depends only on the seed. `on_generation` receives the record of each
    generation.

    The run ends when `nes.solved_for` generations solve the task on average and fresh agents
    confirm it. After `nes.generations` it ends with the SE of the highest mean score, whose
    `info["confirmed"]` is False. Raises InvalidInput for invalid arguments.
    """
    task = get_task(task) if isinstance(task, str) else task
    require(Task, task, "the task to learn", "as bilevel.get_task returns it, or its id")
    hp = recipe if isinstance(recipe, Hyperparameters) else load_recipe(recipe, task)
    nes = NES(task, hp, seed)
    with _executor(workers, executor, task, hp) as running:
        mapped = map if running is None else running.map

        def evaluate_all(
            ses: SEDistribution, requests: list[EvaluationRequest]
        ) -> list[EvaluationResult]:
            return list(mapped(partial(evaluate, task, ses), requests))

        return nes.best(nes.run(evaluate_all, on_generation or (lambda record: None)))


def _executor(
    workers: int, given: Executor | None, task: Task, hp: Hyperparameters
) -> AbstractContextManager[Executor | None]:
    """Return the executor, or None for this process, as a context that closes what it created."""
    if given is not None:
        require(Executor, given, "executor", "as in concurrent.futures")
        return nullcontext(given)
    if not is_number(workers, Integral) or workers < 1:
        raise InvalidInput(f"workers must be an integer of at least 1; got {workers!r}")
    if workers == 1:
        return nullcontext(None)
    # loky's processes do not import the caller's script, which then needs no main guard. They
    # receive the task and the agents that the script may have registered.
    from loky import ProcessPoolExecutor

    agents = [(type(agent), get_agent(agent.agent, task.continuous)) for agent in hp.agents]
    initargs = (task.source.spec, agents)
    pool: AbstractContextManager[Executor]
    pool = ProcessPoolExecutor(int(workers), initializer=_register, initargs=initargs)
    return pool


def _register(
    spec: EnvSpec | None, agents: Sequence[tuple[type[AgentHyperparameters], RegisteredAgent]]
) -> None:
    """Register a task and agents in this process."""
    if spec is not None:
        gymnasium.registry.setdefault(spec.id, spec)
    for hyperparameters, agent in agents:
        register_again(hyperparameters, agent)
