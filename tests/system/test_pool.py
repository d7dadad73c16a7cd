"""The actor pool on a real Ray cluster."""

import contextlib
import os
import time
from dataclasses import replace
from typing import Any

import numpy as np
import psutil
import pytest
import ray

from bilevel.evaluation import EvaluationResult, evaluate
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.synthetic_env import SE
from bilevel.tasks import Task
from cluster.ray.pool import ActorsDied, EvaluationPool
from tests.conftest import ddqn
from tests.ends import kill

pytestmark = [pytest.mark.timeout(120), pytest.mark.usefixtures("joined_ray")]


@pytest.fixture
def nes(cartpole: Task, small_hp: Hyperparameters) -> NES:
    return NES(cartpole, small_hp, seed=1)


def without_times(results: list[EvaluationResult]) -> list[EvaluationResult]:
    return [replace(r, seconds=0.0) for r in sorted(results, key=lambda r: r.index)]


def workers() -> list[psutil.Process]:
    """Return the processes of this cluster's actors, whose title Ray sets."""
    found = []
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if process.name().startswith("ray::_Worker"):
                found.append(process)
    return found


def unchecked(se: SE, psi: np.ndarray[Any, Any]) -> SE:
    """Return the SE with a psi that `SE` would reject or convert."""
    wrong = replace(se)
    object.__setattr__(wrong, "psi", psi)
    return wrong


def test_scores_are_identical_on_any_pool(nes: NES, small_hp: Hyperparameters) -> None:
    """Agents differ in cost, so that the pool changes the order of the requests."""
    state = nes.init()
    requests = [
        replace(r, agent=replace(ddqn(small_hp), batch_size=8 * (1 + r.index)))
        for r in nes.ask(state)
    ]
    looped = [evaluate(nes.task, nes.distribution(state), r) for r in requests]
    for workers in (1, 2):
        with EvaluationPool(workers) as pool:
            results = pool.run(nes.task, nes.distribution(state), requests)
            assert pool.size == workers
        assert without_times(results) == without_times(looped)


def test_killed_actors_are_replaced_and_no_result_is_lost(
    nes: NES, small_hp: Hyperparameters
) -> None:
    state = nes.init()
    agent = replace(ddqn(small_hp), max_episodes=60, hidden_size=64, batch_size=128)
    requests = [replace(r, agent=agent, index=i) for i, r in enumerate(nes.ask(state) * 3)]
    looped = [evaluate(nes.task, nes.distribution(state), r) for r in requests]
    received: list[int] = []
    killed: list[int] = []

    def kill_twice(result: EvaluationResult) -> None:
        received.append(result.index)
        if len(received) in (2, 5):
            killed.append(len(workers()))
            for worker in workers():
                kill(worker)

    with EvaluationPool(2) as pool:
        results = pool.run(nes.task, nes.distribution(state), requests, kill_twice)
    assert all(killed)
    assert sorted(received) == list(range(len(requests)))  # each result once
    assert without_times(results) == without_times(looped)


def test_a_request_that_kills_every_actor_ends_the_run(nes: NES) -> None:
    class Poison(np.ndarray):
        def __reduce__(self):  # type: ignore[no-untyped-def]
            return os._exit, (1,)

    state = nes.init()
    se = unchecked(nes.distribution(state).centre, nes.distribution(state).centre.psi.view(Poison))
    with (
        EvaluationPool(1) as pool,
        pytest.raises(ActorsDied, match=r"^5 actors died .* of ddqn: [^\n]*$"),
    ):
        pool.run(nes.task, se, nes.ask(state)[:1])


def test_an_error_in_an_evaluation_is_raised_and_the_pool_stays_usable(nes: NES) -> None:
    state = nes.init()
    wrong = unchecked(nes.distribution(state).centre, nes.distribution(state).centre.psi[:5])
    requests = nes.ask(state)[:1]
    with EvaluationPool(1) as pool:
        with pytest.raises(ray.exceptions.RayTaskError):
            pool.run(nes.task, wrong, requests)
        assert len(pool.run(nes.task, nes.distribution(state), requests)) == 1


def test_actors_end_with_the_pool(nes: NES) -> None:
    with EvaluationPool(2) as pool:
        pool.run(nes.task, None, [])
    deadline = time.monotonic() + 90
    cores = ray.cluster_resources()["CPU"]
    while workers() or ray.available_resources().get("CPU") != cores:
        assert time.monotonic() < deadline
        time.sleep(0.1)
