from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.nes import NESState
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import SHARE, VALIDATION_FILE, Plan, Validation, validate
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import ConfigLine, Journal, ResultLine
from cluster.ray.pool import EvaluationPool
from tests.studies import MadeUpPool, make_study

TIMES = {"submitted": 0.0, "started": 0.0, "finished": 1.0}
#: The largest budget of the searches here.
LARGEST = 3


def result(number: int, loss: float | None, budget: int = LARGEST) -> ResultLine:
    return ResultLine((0, 0, number), budget, loss, {}, TIMES)


def journal_of(
    folder: Path, losses: Sequence[float | None], smaller: Collection[int] = ()
) -> Journal:
    """A journal of numbered configurations at LARGEST, or at the budget 1 if they are `smaller`."""
    journal = Journal(folder)
    for number, loss in enumerate(losses):
        journal.add_config(ConfigLine((0, 0, number), {}, {}))
        journal.add_result(result(number, loss, 1 if number in smaller else LARGEST))
    return journal


def finalists(journal: Journal, before: Validation | None = None) -> list[int]:
    plan = Plan.of(journal, before, LARGEST)
    return [] if plan is None else [number for _, _, number in plan.finalists]


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


def test_the_last_winner_is_an_additional_finalist(tmp_path: Path) -> None:
    journal = journal_of(tmp_path, [99.0, 20.0, 30.0, 40.0, *[50.0] * 8])
    before = Validation(2, (result(0, 9.0), result(9, 10.0)))
    assert finalists(journal, before) == [0, 1, 2, 3]
    first, second = Plan.of(journal, None, LARGEST), Plan.of(journal, before, LARGEST)
    assert first is not None
    assert second is not None
    assert first.core_seconds == second.core_seconds
    assert finalists(journal, replace(before, results=12)) == [0, 9]  # no results since then


def test_validation_takes_its_share_of_the_core_time(tmp_path: Path) -> None:
    plan = Plan.of(journal_of(tmp_path, [90.0] * 30), None, LARGEST)
    assert plan is not None
    searched, validated = 30 * LARGEST, len(plan.finalists) * plan.core_seconds
    assert validated == pytest.approx(SHARE * (searched + validated), rel=0.05)


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return make_study(tmp_path / "study")


def plan_of(study: Study) -> Plan:
    before = Validation.load(study.folder)
    plan = Plan.of(Journal(study.folder), before, study.schedule.budgets[-1])
    assert plan is not None
    return plan


def run_validation(
    study: Study, is_over: Callable[[], bool] = lambda: False, plan: Plan | None = None
) -> Validation | None:
    spent = []

    def progress(done: float, total: float) -> None:
        assert 0 <= done <= total
        spent.append(done)

    journal, plan = Journal(study.folder), plan or plan_of(study)
    pool, log = MadeUpPool(), print
    found = validate(study, journal, plan, pool, log, progress, is_over)
    assert spent == sorted(spent)
    return found


def test_finalists_run_with_new_seeds_for_equal_core_time(study: Study) -> None:
    plan, found = plan_of(study), run_validation(study)
    assert found is not None
    assert found == Validation.load(study.folder)
    assert found.results == len(Journal(study.folder).results)
    assert {line.id for line in found.finalists} == set(plan.finalists)
    objectives = [line.objective for line in found.finalists]
    assert objectives == sorted(objectives)
    for line in found.finalists:
        assert line.info["core_seconds"] >= plan.core_seconds
        configuration = Journal(study.folder).proposals[line.id].configuration
        searched = ConfigurationRuns.read(study, line.id, configuration)
        validated = ConfigurationRuns.read(study, line.id, configuration, validation=True)
        assert not {searched.run(i).seed for i in range(9)} & {
            validated.run(i).seed for i in range(9)
        }
        assert (line.loss, line.info) == (validated.tally.objective, validated.tally.info)


def test_the_finalist_that_has_spent_least_advances(
    study: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    spent = dict.fromkeys(plan_of(study).finalists, 0.0)
    advance = ConfigurationRuns.advance

    def watched(runs: ConfigurationRuns, pool: EvaluationPool) -> NESState:
        assert spent[runs.id] == min(spent.values())
        state = advance(runs, pool)
        spent[runs.id] = runs.tally.cost
        return state

    monkeypatch.setattr(ConfigurationRuns, "advance", watched)
    rounds = iter(range(4 * len(spent)))
    run_validation(study, lambda: next(rounds, None) is None)
    assert min(spent.values()) > 0


def test_too_little_time_keeps_the_last_validation(study: Study) -> None:
    assert run_validation(study, lambda: True) is None
    assert not (study.folder / VALIDATION_FILE).exists()
    last = Validation(1, (result(0, 1.0), result(1, 2.0)))
    last.save(study.folder)
    assert run_validation(study, lambda: True) is None
    assert Validation.load(study.folder) == last


@pytest.mark.parametrize(("share", "enough"), [(0.5, False), (1.5, True)])
def test_the_largest_budget_is_enough_at_the_deadline(
    share: float, enough: bool, study: Study
) -> None:
    largest, plan = study.schedule.budgets[-1], plan_of(study)
    proposals = Journal(study.folder).proposals

    def is_over() -> bool:
        runs = [
            ConfigurationRuns.read(study, id, proposals[id].configuration, True)
            for id in plan.finalists
        ]
        return min(each.tally.cost for each in runs) >= share * largest

    found = run_validation(study, is_over, replace(plan, core_seconds=100 * largest))
    assert (found is not None) == enough


def test_a_resumed_validation_has_the_same_outcome(study: Study, tmp_path: Path) -> None:
    rounds = iter(range(5))
    run_validation(study, lambda: next(rounds, None) is None)
    resumed, whole = run_validation(study), run_validation(make_study(tmp_path / "whole"))
    assert resumed is not None
    assert whole is not None
    assert resumed.outcome == whole.outcome
    assert run_validation(study) == resumed  # with its times


def test_a_failing_finalist_is_left_out(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    failing, *others = plan_of(study).finalists
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
