from collections.abc import Callable
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


def journal_of(
    folder: Path, losses: dict[int, float | None], budgets: dict[int, int] | None = None
) -> Journal:
    """A journal of numbered configurations. Their budgets are LARGEST by default."""
    journal = Journal(folder)
    for number, loss in losses.items():
        journal.add_config(ConfigLine((0, 0, number), {}, {}))
        budget = (budgets or {}).get(number, LARGEST)
        journal.add_result(ResultLine((0, 0, number), budget, loss, {}, TIMES))
    return journal


def equal_losses(count: int, **losses: float | None) -> dict[int, float | None]:
    """Equal losses except for the given ones, as `_3=20.0`."""
    changed = {int(name[1:]): loss for name, loss in losses.items()}
    return {**dict.fromkeys(range(count), 90.0), **changed}


def result(number: int, loss: float = 9.0) -> ResultLine:
    return ResultLine((0, 0, number), 5, loss, {}, TIMES)


def finalists(journal: Journal, before: Validation | None = None) -> list[int]:
    plan = Plan.of(journal, before, LARGEST)
    return [] if plan is None else [number for _, _, number in plan.finalists]


class TestPlan:
    def test_the_best_at_the_largest_budget(self, tmp_path: Path) -> None:
        losses = equal_losses(11, _1=20.0, _2=None, _3=40.0, _4=30.0, _10=1.0)
        assert finalists(journal_of(tmp_path, losses, {10: 1})) == [1, 3, 4]

    def test_smaller_budgets_where_the_largest_has_too_few_results(self, tmp_path: Path) -> None:
        budgets = dict.fromkeys(range(1, 30), 1)
        assert finalists(journal_of(tmp_path, equal_losses(30, _7=2.0, _9=1.0), budgets)) == [
            0,
            7,
            9,
        ]

    def test_the_recipe_is_always_a_finalist(self, tmp_path: Path) -> None:
        journal = journal_of(tmp_path, equal_losses(10, _0=99.0, _1=20.0, _2=30.0))
        journal.configs[0] = journal.configs[0]._replace(info={"prior": "itself"})
        assert finalists(journal) == [0, 1, 2]

    def test_the_last_winner_is_an_additional_finalist(self, tmp_path: Path) -> None:
        journal = journal_of(tmp_path, equal_losses(12, _1=20.0, _2=30.0, _3=40.0))
        before = Validation(2, (result(0),))
        assert finalists(journal, before) == [0, 1, 2, 3]
        first, second = Plan.of(journal, None, LARGEST), Plan.of(journal, before, LARGEST)
        assert first is not None
        assert second is not None
        assert first.core_seconds == second.core_seconds

    def test_without_new_results_the_finalists_stay(self, tmp_path: Path) -> None:
        journal = journal_of(tmp_path, equal_losses(10, _1=20.0))
        assert finalists(journal, Validation(10, (result(5), result(7)))) == [5, 7]

    @pytest.mark.parametrize(("searched", "number"), [(2, 0), (3, 2), (6, 2), (8, 2), (9, 3)])
    def test_the_number_of_finalists_depends_on_the_core_time(
        self, searched: int, number: int, tmp_path: Path
    ) -> None:
        """Each gets the largest budget; two may get half of it."""
        assert len(finalists(journal_of(tmp_path, equal_losses(searched)))) == number

    def test_nothing_to_compare(self, tmp_path: Path) -> None:
        failures = dict.fromkeys(range(1, 30))
        assert not finalists(journal_of(tmp_path, {0: 90.0, **failures}))
        assert not finalists(Journal(tmp_path / "empty"))

    def test_validation_takes_its_share_of_the_core_time(self, tmp_path: Path) -> None:
        plan = Plan.of(journal_of(tmp_path, equal_losses(30)), None, LARGEST)
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
    last = Validation(1, (result(0), result(1)))
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
        return min(one.tally.cost for one in runs) >= share * largest

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
