"""A whole NES run in one call, without Ray, MLflow or files."""

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
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters, load_recipe
from bilevel.nes.algorithm import NES
from bilevel.nes.records import GenerationRecord
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

    `recipe` is a recipe's name or file, or hyperparameters. Evaluations run in this process or in
    `workers` processes, or on `executor`, which is left open and whose processes must know the task
    and the agents; the SE depends on the seed alone.
    `on_generation` is called with the record of each generation. The run ends once it has solved
    the task over `nes.solved_for` generations on average and fresh agents confirm it, or after
    `nes.generations`. Then its best SE is that of the highest mean score, which is lucky, too (the
    command `bilevel nes` tests the best ones again before it chooses); `info["confirmed"]` of the
    SE tells the two ends apart.

    Raises InvalidInput for an unknown task or recipe, fewer than one worker, or hyperparameters
    that do not fit together.
    """
    task = get_task(task) if isinstance(task, str) else task
    require(Task, task, "the task to learn", "as bilevel.get_task returns it, or its id")
    hp = recipe if isinstance(recipe, Hyperparameters) else load_recipe(recipe, task.id)
    nes = NES(task, hp, seed)
    with _executor(workers, executor, task, hp) as running:
        mapped = map if running is None else running.map

        def evaluate_all(
            ses: SEDistribution, requests: list[EvaluationRequest]
        ) -> list[EvaluationResult]:
            return list(mapped(partial(evaluate, task, ses), requests))

        return nes.run(evaluate_all, on_generation or (lambda record: None)).best


def _executor(
    workers: int, given: Executor | None, task: Task, hp: Hyperparameters
) -> AbstractContextManager[Executor | None]:
    """The executor of the evaluations as a context that closes it, unless it was `given`; None
    means this process. Raises InvalidInput for fewer than one worker."""
    if isinstance(given, type):
        raise InvalidInput(f"executor must be one of {given.__name__}, not the class: call it")
    if given is not None:
        return nullcontext(given)
    if not is_number(workers, Integral) or workers < 1:
        raise InvalidInput(f"workers must be an integer of at least 1; got {workers!r}")
    workers = int(workers)
    if workers == 1:
        return nullcontext(None)
    # loky's processes do not import the caller's script, which then needs no main guard. They are
    # given the task and the agents that the script itself may have registered.
    from loky import ProcessPoolExecutor

    agents = [(type(agent), get_agent(agent.agent)) for agent in hp.agents]
    pool: AbstractContextManager[Executor] = ProcessPoolExecutor(
        workers, initializer=_register, initargs=(gymnasium.registry.get(task.id), agents)
    )
    return pool


def _register(
    spec: EnvSpec | None, agents: Sequence[tuple[type[AgentHyperparameters], RegisteredAgent]]
) -> None:
    """Make a task, if it is given, and agents known to this process."""
    if spec is not None:
        gymnasium.registry.setdefault(spec.id, spec)
    for hyperparameters, agent in agents:
        register_again(hyperparameters, agent)
