"""The actor pool on a real Ray cluster."""

import contextlib
import os
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ray

from bilevel.evaluation import EvaluationResult, evaluate
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.synthetic_env import SE
from bilevel.tasks import Task
from cluster.ray.pool import ActorsDied, EvaluationPool
from tests.conftest import ddqn

pytestmark = [pytest.mark.timeout(120), pytest.mark.usefixtures("joined_ray")]


def without_times(results: list[EvaluationResult]) -> list[EvaluationResult]:
    return [replace(r, seconds=0.0) for r in sorted(results, key=lambda r: r.index)]


@pytest.fixture
def nes(cartpole: Task, small_hp: Hyperparameters) -> NES:
    return NES(cartpole, small_hp, seed=1)


def worker_pids() -> list[int]:
    """Processes of this cluster's evaluation actors, found by their title, which Ray sets, and
    their raylet, which is a child of this process."""
    pids = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            is_worker = (folder / "cmdline").read_bytes().startswith(b"ray::_Worker")
            if is_worker and parent(parent(int(folder.name))) == os.getpid():
                pids.append(int(folder.name))
    return pids


def parent(pid: int) -> int:
    """The parent of a process: the fourth field of its stat file, after a name in parentheses."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def test_any_number_of_actors_gives_what_a_loop_gives(nes: NES, small_hp: Hyperparameters) -> None:
    """Agents differ in cost, so that requests are handed out in another order."""
    state = nes.init()
    requests = [
        replace(r, agent=replace(ddqn(small_hp), batch_size=8 * (1 + r.index)))
        for r in nes.ask(state)
    ]
    looped = [evaluate(nes.task, state.se, r) for r in requests]
    for workers in (1, 2):
        with EvaluationPool(workers) as pool:
            results = pool.run(nes.task, state.se, requests)
            assert pool.evaluation_seconds == pytest.approx(sum(r.seconds for r in results))
        assert without_times(results) == without_times(looped)


def test_killed_actors_are_replaced_and_nothing_is_lost(
    nes: NES, small_hp: Hyperparameters
) -> None:
    agent = replace(ddqn(small_hp), max_episodes=60, hidden_size=64, batch_size=128)
    state = nes.init()
    requests = [replace(r, agent=agent) for r in nes.ask(state) * 3]
    requests = [replace(r, index=i) for i, r in enumerate(requests)]
    looped = [evaluate(nes.task, state.se, r) for r in requests]
    killed: list[int] = []
    over = threading.Event()

    def kill_some() -> None:
        while len(killed) < 3 and not over.wait(0.3):
            for pid in worker_pids()[:1]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
                    killed.append(pid)

    with EvaluationPool(2) as pool:
        pool.run(nes.task, state.se, requests[:2])  # both are up
        killer = threading.Thread(target=kill_some)
        killer.start()
        results = pool.run(nes.task, state.se, requests)
        over.set()
        killer.join()
    assert killed
    assert without_times(results) == without_times(looped)


def test_one_se_is_evaluated_as_a_distribution_at_its_centre(nes: NES) -> None:
    state = nes.init()
    requests = nes.ask(state)[: nes.hp.nes.centre_agents]
    with EvaluationPool(1) as pool:
        results = [pool.run(nes.task, se, requests) for se in (state.se, state.se.centre)]
    assert without_times(results[0]) == without_times(results[1])


def test_the_choice_of_a_start_is_what_a_loop_makes_of_it(
    cartpole: Task, small_hp: Hyperparameters
) -> None:
    """Actors that are killed after their start are replaced, and lost results computed again."""
    nes = NES(cartpole, replace(small_hp, nes=replace(small_hp.nes, start_candidates=9)), 1)
    pooled = looped = nes.init()
    with EvaluationPool(2) as pool:
        while not looped.started:
            results = [evaluate(cartpole, looped.se, r) for r in nes.ask(looped)]
            looped = nes.tell(looped, results)
            answered: list[int] = []

            def kill_all(result: EvaluationResult, answered: list[int] = answered) -> None:
                answered.append(result.index)
                for pid in worker_pids() if len(answered) == 1 else ():
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)

            results = pool.run(cartpole, pooled.se, nes.ask(pooled), kill_all)
            assert sorted(answered) == list(range(len(results)))
            pooled = nes.tell(pooled, results)
            assert pooled.race == looped.race
    np.testing.assert_array_equal(pooled.se.mean, looped.se.mean)


def unchecked(se: SE, psi: np.ndarray[Any, Any]) -> SE:
    """The SE with psi that `SE` would refuse or change."""
    wrong = replace(se)
    object.__setattr__(wrong, "psi", psi)
    return wrong


def test_a_request_that_kills_every_actor_is_given_up(nes: NES) -> None:
    class Poison(np.ndarray):
        def __reduce__(self):  # type: ignore[no-untyped-def]
            return os._exit, (1,)

    state = nes.init()
    se = unchecked(state.se.centre, state.se.centre.psi.view(Poison))
    with (
        EvaluationPool(1) as pool,
        pytest.raises(ActorsDied, match=r"^5 actors died .* agent ddqn: [^\n]*$"),
    ):
        pool.run(nes.task, se, nes.ask(state)[:1])


def test_an_error_in_an_evaluation_is_the_callers(nes: NES) -> None:
    state = nes.init()
    wrong = unchecked(state.se.centre, state.se.centre.psi[:5])
    with EvaluationPool(1) as pool, pytest.raises(ray.exceptions.RayTaskError):
        pool.run(nes.task, wrong, nes.ask(state)[:1])


def test_the_pool_is_gone_afterwards(nes: NES) -> None:
    with EvaluationPool(2) as pool:
        pool.run(nes.task, None, [])
        assert pool.size == 2
    deadline = time.monotonic() + 90
    cores = ray.cluster_resources()["CPU"]
    while time.monotonic() < deadline:
        if not worker_pids() and ray.available_resources().get("CPU") == cores:
            return
        time.sleep(0.1)
    pytest.fail("actors or their resources are still there")
