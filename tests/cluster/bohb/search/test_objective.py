"""The objective: expected core time to a confirmed SE."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bilevel.nes import NESState
from cluster.bohb.search.bracket_search import Job
from cluster.bohb.search.objective import Tally
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import Journal, Origin
from tests.studies import MadeUpPool, make_study, new_study, run_job


@pytest.fixture
def state(tmp_path: Path) -> NESState:
    """A run after some generations."""
    runs = ConfigurationRuns.open(new_study(tmp_path), (0, 0, 0), {})
    runs.spend(2, MadeUpPool())
    (state,) = runs.states
    assert state.generation > 4
    return state


def scored(state: NESState, score: float, **changes: object) -> NESState:
    records = tuple(replace(record, score_mean=score) for record in state.records)
    return replace(state, records=records, **changes)  # type: ignore[arg-type]


def test_time_over_successes() -> None:
    """Failed runs cost their time."""
    assert Tally(300.0, 3, 3, 0.0).objective == pytest.approx(100.0, rel=0.01)
    assert Tally(300.0, 3, 2, 0.0).objective == pytest.approx(150.0, rel=0.01)
    one_lucky, two = Tally(300.0, 4, 1, 0.2), Tally(300.0, 3, 2, 0.0)
    assert two.objective < one_lucky.objective


def test_a_run_that_is_not_over_counts_less_than_an_se() -> None:
    nearly, confirmed = Tally(30.0, 1, 0, 1.0), Tally(30.0, 1, 1, 0.0)
    begun, nothing = Tally(30.0, 1, 0, 0.1), Tally(30.0, 1, 0, 0.0)
    order = [confirmed, nearly, begun, nothing]
    assert [one.objective for one in order] == sorted(one.objective for one in order)
    assert len({one.objective for one in order}) == 4


def test_what_is_counted(state: NESState) -> None:
    over = replace(state, finished=True)
    confirmed = replace(over, confirmed=True)
    half = scored(state, state.task.solved_reward / 2)  # of a task whose worst score is 0
    found = Tally.of([confirmed, over, half])
    assert state.task.worst_score == 0.0
    assert found == Tally(3 * state.cost, 3, 1, found.progress)
    assert found.progress == pytest.approx(0.5)
    low = replace(half, task=replace(state.task, worst_score=-3 * state.task.solved_reward))
    assert Tally.of([low]).progress == pytest.approx(3.5 / 4)
    assert Tally.of([confirmed, over]).progress == 0.0
    assert Tally.of([scored(state, 500.0)]).progress == 1.0
    assert Tally.of([]).objective == 0.0


def test_progress_is_that_of_the_last_scores(state: NESState) -> None:
    """Of the last four, in the attempt that is under way."""
    solved = state.task.solved_reward
    scores = [0.0] * 4 + [solved] * 4
    records = tuple(replace(state.records[0], score_mean=score) for score in scores)
    assert Tally.of([replace(state, records=records)]).progress == 1.0
    assert Tally.of([replace(state, records=records[:6])]).progress == 0.5
    assert Tally.of([replace(state, records=records[:6], attempt_began=5)]).progress == 1.0
    assert Tally.of([replace(state, records=records[:6], attempt_began=6)]).progress == 0.0


def test_seed_after_seed_until_the_budget_is_spent(tmp_path: Path) -> None:
    """A configuration goes on where a smaller budget ended, and comes to the same."""
    study = new_study(tmp_path / "one")
    few = replace(study.base, nes=replace(study.base.nes, generations=3))
    study = replace(study, base=few)
    job = Job((0, 0, 0), {"nes.population_size": 4}, 1, Origin.RANDOM, 0.0)
    run_job(study, job)
    parts = run_job(study, replace(job, budget=4))
    other = replace(study, folder=tmp_path / "other")
    assert run_job(other, replace(job, budget=4)) == parts
    assert parts.cost == pytest.approx(4.0, abs=0.5)
    runs = ConfigurationRuns.read(study, job.id, job.configuration)
    assert parts.runs == len(runs.states) > 3
    assert all(state.finished for state in runs.states[:-1])
    starts = {state.se.mean.tobytes() for state in runs.states}
    assert len(starts) == len(runs.states)


def test_a_damaged_run_is_run_again_before_others(tmp_path: Path) -> None:
    study = new_study(tmp_path)
    study = replace(study, base=replace(study.base, nes=replace(study.base.nes, generations=3)))
    job = Job((0, 0, 0), {"nes.population_size": 4}, 2, Origin.RANDOM, 0.0)
    before = run_job(study, job)
    (study.run(job.id, job.configuration, 0).folder / "state.safetensors").write_bytes(b"damaged")
    runs = ConfigurationRuns.open(study, job.id, job.configuration)
    assert not runs.spent(job.budget)
    runs.spend(job.budget, MadeUpPool())
    assert runs.tally == before


def test_a_lost_run_is_run_again_and_the_others_stay(tmp_path: Path) -> None:
    """Those after it are over: advanced once more, a confirmed SE would be another one."""
    study = new_study(tmp_path)
    study = replace(study, base=replace(study.base, nes=replace(study.base.nes, generations=3)))
    id, configuration = (0, 0, 0), {"nes.population_size": 4}
    runs = ConfigurationRuns.open(study, id, configuration)
    runs.spend(3, MadeUpPool())
    assert len(runs.states) > 2
    (runs.run(0).folder / "state.safetensors").unlink()
    again = ConfigurationRuns.open(study, id, configuration)
    assert not again.states
    again.spend(3, MadeUpPool())
    assert again.tally == runs.tally
    for state, before in zip(again.states, runs.states, strict=True):
        assert state.generation == before.generation
        np.testing.assert_array_equal(state.se.mean, before.se.mean)


def test_the_best_se_is_a_confirmed_one(state: NESState, tmp_path: Path) -> None:
    study: Study = make_study(tmp_path / "study")
    line = Journal(study.folder).configs[0]
    runs = ConfigurationRuns.read(study, line.id, line.configuration)
    high = scored(state, 190.0)
    runs.states = [high, replace(scored(state, 100.0), finished=True, confirmed=True)]
    best = runs.best
    assert best is not None
    assert best.info["generation"] == state.generation
    runs.states = [high]
    assert runs.best is not None
    runs.states = []
    assert runs.best is None


def test_in_words() -> None:
    assert (
        Tally.describe(Tally(31.2, 1, 0, 0.61).info)
        == "none confirmed in 31 core s, scores 61% of the way"
    )
    assert Tally.describe(Tally(31.2, 1, 1, 0.0).info) == "1 SE in 31 core s"
    assert Tally.describe(Tally(95.0, 3, 2, 0.3).info) == "2 SEs in 95 core s"
