from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import pytest

from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.nes import NESState
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import (
    SHARE,
    VALIDATION_FILE,
    Validation,
    finalists_of,
    validate,
)
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import ConfigId, ConfigLine, Journal, ResultLine
from cluster.ray.pool import EvaluationPool
from tests.studies import MadeUpPool, make_study

TIMES = {"submitted": 0.0, "started": 0.0, "finished": 1.0}
#: The largest budget of the searches here.
LARGEST = 3


def journal_of(
    folder: Path, losses: Sequence[float | None], smaller: Collection[int] = ()
) -> Journal:
    """A journal of numbered configurations at LARGEST, or at the budget 1 if they are `smaller`."""
    journal = Journal(folder)
    for number, loss in enumerate(losses):
        budget = 1 if number in smaller else LARGEST
        journal.add_config(ConfigLine((0, 0, number), {}, {}))
        journal.add_result(ResultLine((0, 0, number), budget, loss, {}, TIMES))
    return journal


def finalists(journal: Journal) -> list[int]:
    return [number for _, _, number in finalists_of(journal, LARGEST)]


@pytest.mark.parametrize(
    ("losses", "smaller", "expected"),
    [
        ([90, 20, None, 40, 30, 90, 90, 90, 90, 90, 1], [10], [1, 3, 4]),  # the best
        ([90] * 7 + [2, 1] + [90] * 20, range(1, 29), [0, 7, 8]),  # smaller budgets come last
        ([90] * 2, [], []),  # too short
        ([90] * 3, [], [0, 1]),  # each gets half of the largest budget
        ([90] * 8, [], [0, 1]),
        ([90] * 9, [], [0, 1, 2]),  # each gets the largest budget
        ([90] * 30, [], [0, 1, 2]),
        ([90] + [None] * 29, [], []),  # nothing to compare
        ([], [], []),
    ],
)
def test_finalists_are_the_best_configurations(
    losses: list[float | None], smaller: Collection[int], expected: list[int], tmp_path: Path
) -> None:
    assert finalists(journal_of(tmp_path, losses, smaller)) == expected


def test_the_recipe_is_always_a_finalist(tmp_path: Path) -> None:
    journal = journal_of(tmp_path, [99.0, 20.0, 30.0, *[50.0] * 7])
    journal.configs[0] = journal.configs[0]._replace(info={"prior": "itself"})
    assert finalists(journal) == [0, 1, 2]


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return make_study(tmp_path / "study")


def chosen(study: Study) -> list[ConfigId]:
    return finalists_of(Journal(study.folder), study.schedule.budgets[-1])


def run_validation(study: Study, is_over: Callable[[], bool] = lambda: False) -> Validation | None:
    spent = []

    def progress(done: float, total: float) -> None:
        assert 0 <= done <= total
        spent.append(done)

    found = validate(study, Journal(study.folder), MadeUpPool(), print, progress, is_over)
    assert spent == sorted(spent)
    return found


def test_finalists_run_with_new_seeds_for_equal_core_time(study: Study) -> None:
    found, journal = run_validation(study), Journal(study.folder)
    assert found is not None
    assert found == Validation.load(study.folder)
    assert found.results == len(journal.results)
    assert {line.id for line in found.finalists} == set(chosen(study))
    searched_for = sum(journal.reached.values())
    each = SHARE / (1 - SHARE) * searched_for / len(found.finalists)
    objectives = [line.objective for line in found.finalists]
    assert objectives == sorted(objectives)
    for line in found.finalists:
        assert line.info["core_seconds"] >= each
        configuration = journal.proposals[line.id].configuration
        searched = ConfigurationRuns(study, line.id, configuration).read()
        validated = ConfigurationRuns(study, line.id, configuration, validation=True).read()
        assert searched.run(0).seed != validated.run(0).seed
        assert (line.loss, line.info) == (validated.tally.objective, validated.tally.info)


def test_a_resumed_validation_has_the_same_results(study: Study, tmp_path: Path) -> None:
    assert run_validation(study, lambda: True) is None  # too little time
    assert not (study.folder / VALIDATION_FILE).exists()
    rounds = iter(range(5))
    run_validation(study, lambda: next(rounds, None) is None)
    resumed, whole = run_validation(study), run_validation(make_study(tmp_path / "whole"))
    assert resumed is not None
    assert whole is not None
    for line, expected in zip(resumed.finalists, whole.finalists, strict=True):
        assert (line.id, line.loss, line.info) == (expected.id, expected.loss, expected.info)
    assert run_validation(study) == resumed  # with its times


def test_a_failing_finalist_is_left_out(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    failing, *others = chosen(study)
    advance = ConfigurationRuns.advance

    def sometimes(runs: ConfigurationRuns, pool: EvaluationPool) -> NESState:
        if runs.id == failing:
            raise InvalidInput("agent 'mine' returned nothing")
        return advance(runs, pool)

    monkeypatch.setattr(ConfigurationRuns, "advance", sometimes)
    found = run_validation(study)
    assert found is not None
    assert {line.id for line in found.finalists} == {*others}


@pytest.mark.parametrize("failure", [StorageFailure("full"), OtherVersion("checkpoint", 1, 2)])
def test_failures_of_the_study_end_the_validation(
    failure: InvalidInput, study: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(runs: ConfigurationRuns, pool: EvaluationPool) -> NESState:
        raise failure

    monkeypatch.setattr(ConfigurationRuns, "advance", fail)
    with pytest.raises(type(failure)):
        run_validation(study)


def test_a_damaged_validation_is_reported(tmp_path: Path) -> None:
    (tmp_path / VALIDATION_FILE).write_text('{"results": 3}')
    with pytest.raises(InvalidInput, match="damaged validation"):
        Validation.load(tmp_path)
