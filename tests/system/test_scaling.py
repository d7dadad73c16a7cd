"""What measures evaluations for the simulations of scale, on real processes and Ray."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.scaling.evaluations import processes
from benchmarks.scaling.nes_runs import generation_path, record
from benchmarks.scaling.pool import overhead, replayed
from bilevel.evaluation import evaluate
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES, NESState
from bilevel.tasks import Task
from cluster.pool import EvaluationPool

pytestmark = pytest.mark.timeout(120)


@pytest.fixture
def recorded(cartpole: Task, small_hp: Hyperparameters) -> NES:
    nes = replace(small_hp.nes, start_candidates=4)
    return NES(cartpole, replace(small_hp, nes=nes), seed=1)


def test_a_run_is_recorded_as_it_would_go_unrecorded(recorded: NES, tmp_path: Path) -> None:
    path = generation_path(tmp_path, "CartPole-v0", 1, 2)
    path.parent.mkdir()
    with processes() as workers:
        rows = record(recorded, 2, workers, tmp_path)
    nes = recorded
    state = nes.start(
        lambda psi, asked: [evaluate(nes.task, nes.architecture, psi, r) for r in asked]
    )
    for row in rows["generations"]:
        results = [evaluate(nes.task, nes.architecture, state.psi, r) for r in nes.ask(state)]
        state = nes.tell(state, results, 0.0, 0.0)
        assert row["train_steps"] == [result.train_steps for result in results]
        assert row["score"] == round(state.records[-1].score_mean, 1)
    assert (NESState.load(path).psi == state.psi).all()
    assert [len(rows["screening"]["seconds"]), len(rows["retests"]["seconds"])] == [8, 8]


@pytest.mark.usefixtures("local_ray")
def test_the_pool_is_measured(recorded: NES, small_hp: Hyperparameters, tmp_path: Path) -> None:
    path = generation_path(tmp_path, "CartPole-v0", 1, 0)
    path.parent.mkdir()
    replace(recorded, hp=small_hp).start().save(path)
    with EvaluationPool(1) as pool:
        costs = overhead(pool)
        (row,) = replayed(pool, recorded, tmp_path, [0])
    assert 0 < costs["evaluation_ms"] < costs["actor_ms"]
    assert costs["driver_ms"] > 0
    assert len(row["seconds"]) == recorded.hp.nes.evaluations
    assert sum(row["seconds"]) < row["wall_seconds"]
