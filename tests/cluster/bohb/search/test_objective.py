from dataclasses import replace

import pytest

from bilevel.nes import NESState
from bilevel.nes.state import Finished
from bilevel.tasks import Task
from cluster.bohb.search.objective import Tally
from cluster.bohb.search.runs import ConfigurationRuns
from tests.studies import MadeUpPool, new_study


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> NESState:
    """An unfinished run after some generations."""
    runs = ConfigurationRuns(new_study(tmp_path_factory.mktemp("study")), (0, 0, 0), {}).read()
    runs.spend(2, MadeUpPool())
    (state,) = runs.states
    assert state.generation > 4
    return state


def scored(state: NESState, *scores: float, **changes: object) -> NESState:
    """The run after generations with these scores."""
    records = tuple(replace(state.records[0], score_mean=score) for score in scores)
    return replace(state, records=records, **changes)  # type: ignore[arg-type]


def test_the_objective_is_cost_over_successes(cartpole: Task) -> None:
    assert Tally(300.0, 3, 3, 0.0).objective == pytest.approx(100.0, rel=0.01)
    assert Tally(300.0, 3, 2, 0.0).objective == pytest.approx(150.0, rel=0.01)
    assert Tally(300.0, 3, 0, 1.0).objective == pytest.approx(600.0)
    assert Tally.of([], cartpole).objective == 0.0


def test_costs_and_successes_are_counted(state: NESState, cartpole: Task) -> None:
    over = replace(state, phase=Finished())
    confirmed = replace(state, phase=Finished(confirmed=True))
    assert Tally.of([confirmed, over], cartpole) == Tally(2 * state.cost, 2, 1, 0.0)
    half = scored(state, cartpole.solved_reward / 2)
    assert Tally.of([confirmed, over, half], cartpole) == Tally(3 * state.cost, 3, 1, 0.5)


@pytest.mark.parametrize(
    ("scores", "attempt_start", "progress"),
    [
        ([500.0], 0, 1.0),
        ([0.0] * 4 + [195.0] * 4, 0, 1.0),  # the last four
        ([0.0] * 4 + [195.0] * 2, 0, 0.5),
        ([0.0] * 4 + [195.0] * 2, 5, 1.0),  # only the current attempt
        ([0.0] * 4 + [195.0] * 2, 6, 0.0),
    ],
)
def test_progress_of_recent_scores(
    scores: list[float], attempt_start: int, progress: float, state: NESState, cartpole: Task
) -> None:
    assert (cartpole.worst_score, cartpole.solved_reward) == (0.0, 195.0)
    run = scored(state, *scores, attempt_start=attempt_start)
    assert Tally.of([run], cartpole).progress == progress


def test_progress_starts_at_the_worst_score(state: NESState, cartpole: Task) -> None:
    task = replace(cartpole, worst_score=-3 * cartpole.solved_reward)
    run = scored(state, cartpole.solved_reward / 2)
    assert Tally.of([run], task).progress == pytest.approx(3.5 / 4)
