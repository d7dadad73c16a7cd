"""The finalists of a search run anew, and the best of these runs is handed over."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.nes import NESState
from cluster.bohb.results.summary import StudySummary
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import (
    SHARE,
    VALIDATION_FILE,
    Plan,
    Validation,
    least_search,
    validate,
)
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import ConfigLine, Journal, ResultLine
from cluster.ray.pool import EvaluationPool
from tests.studies import MadeUpPool, make_study

STAMPS = {"submitted": 0.0, "started": 0.0, "finished": 1.0}
#: The largest budget of the searches here.
LARGEST = 3


def journal_of(folder: Path, losses: dict[int, float | None], prior: int | None = None) -> Journal:
    """A journal with these configurations at the budget 3; number `prior` is the recipe's own."""
    journal = Journal(folder)
    for number, loss in losses.items():
        info = {"prior": "itself"} if number == prior else {}
        journal.add_config(ConfigLine((0, 0, number), {}, info))
        journal.add_result(ResultLine((0, 0, number), 3, loss, {}, STAMPS))
    return journal


def finalists(journal: Journal, before: Validation | None = None) -> list[int]:
    """Numbers of the configurations that would be validated."""
    plan = Plan.of(journal, before, LARGEST)
    return [] if plan is None else [number for _, _, number in plan.finalists]


def run_validation(
    study: Study, is_over: Callable[[], bool] = lambda: False
) -> tuple[Validation | None, list[tuple[float, float]]]:
    told: list[tuple[float, float]] = []

    def progress(spent: float, total: float) -> None:
        told.append((spent, total))

    journal = Journal(study.folder)
    largest = study.schedule.budgets[-1]
    plan = Plan.of(journal, Validation.load(study.folder), largest)
    assert plan is not None
    found = validate(study, journal, plan, MadeUpPool(), lambda line: None, progress, is_over)
    return found, told


class TestPlan:
    def test_the_best_at_the_largest_budget(self, tmp_path: Path) -> None:
        losses: dict[int, float | None] = dict.fromkeys(range(10), 90.0)
        journal = journal_of(tmp_path, {**losses, 1: 20.0, 2: None, 3: 40.0, 4: 30.0})
        journal.add_config(ConfigLine((0, 0, 10), {}, {}))
        journal.add_result(ResultLine((0, 0, 10), 1, 1.0, {}, STAMPS))  # a smaller budget
        assert finalists(journal) == [1, 3, 4]

    def test_then_those_at_smaller_budgets(self, tmp_path: Path) -> None:
        """So that a search with one result at its largest budget is validated too."""
        journal = journal_of(tmp_path, {0: 50.0})
        for number in range(1, 30):
            journal.add_config(ConfigLine((0, 0, number), {}, {}))
            journal.add_result(ResultLine((0, 0, number), 1, 30.0 - number, {}, STAMPS))
        assert finalists(journal) == [0, 28, 29]

    def test_a_validation_of_the_same_results_is_not_planned_anew(self, tmp_path: Path) -> None:
        """A study that was stopped after it: a winner of before was among its finalists."""
        losses: dict[int, float | None] = dict.fromkeys(range(10), 90.0)
        journal = journal_of(tmp_path, {**losses, 1: 20.0, 3: 40.0, 4: 30.0})
        lines = {line.id[2]: line for line in journal.results}
        earlier = Validation(5, (lines[7], lines[1]))
        assert finalists(journal, earlier) == [1, 3, 4, 7]
        now = Validation(10, (lines[1], lines[3], lines[4], lines[7]))
        assert Plan.of(journal, now, LARGEST) == Plan.of(journal, earlier, LARGEST)

    def test_the_recipe_is_one_of_them(self, tmp_path: Path) -> None:
        """Whatever its result was: so what is handed over has been compared with it."""
        losses: dict[int, float | None] = dict.fromkeys(range(10), 50.0)
        journal = journal_of(tmp_path, {**losses, 0: 90.0, 1: 20.0, 2: 30.0}, prior=0)
        assert finalists(journal) == [0, 1, 2]

    def test_the_last_winner_comes_on_top(self, tmp_path: Path) -> None:
        losses: dict[int, float | None] = dict.fromkeys(range(12), 50.0)
        journal = journal_of(tmp_path, {**losses, 0: 90.0, 1: 20.0, 2: 30.0, 3: 40.0})
        before = Validation(2, (ResultLine((0, 0, 0), 5, 9.0, {}, STAMPS),))
        assert finalists(journal, before) == [0, 1, 2, 3]
        one, two = Plan.of(journal, None, LARGEST), Plan.of(journal, before, LARGEST)
        assert one is not None
        assert two is not None
        assert two.core_seconds == one.core_seconds  # of each

    @pytest.mark.parametrize(("searched", "number"), [(2, 0), (3, 2), (6, 2), (8, 2), (9, 3)])
    def test_as_many_as_get_the_largest_budget(
        self, searched: int, number: int, tmp_path: Path
    ) -> None:
        """Two with half of it at least; a search of less is not validated."""
        assert len(finalists(journal_of(tmp_path, dict.fromkeys(range(searched), 5.0)))) == number

    def test_the_last_winner_keeps_nobody_out(self, tmp_path: Path) -> None:
        """Its earlier runs count, so that it takes little of the time."""
        journal = journal_of(tmp_path, {0: 50.0, 1: 40.0, 2: 9.0, 3: 8.0})
        assert finalists(journal) == [2, 3]
        before = Validation(3, (ResultLine((0, 0, 0), 4, 45.0, {}, STAMPS),))
        assert finalists(journal, before) == [0, 2, 3]

    def test_a_search_that_never_reached_it_is_as_long(self, tmp_path: Path) -> None:
        """Nine configurations at the budget 3 are enough for it, and too few for a larger one."""
        journal = journal_of(tmp_path, dict.fromkeys(range(9), 5.0))
        assert Plan.of(journal, None, 9) == Plan(((0, 0, 0), (0, 0, 1)), 5)
        assert Plan.of(journal, None, 10) is None
        assert least_search(9) == 27 == sum(journal.reached.values())

    def test_nothing_to_compare(self, tmp_path: Path) -> None:
        failed: dict[int, float | None] = dict.fromkeys(range(1, 30))
        assert Plan.of(journal_of(tmp_path, {0: 90.0, **failed}), None, LARGEST) is None
        assert Plan.of(Journal(tmp_path / "empty"), None, LARGEST) is None

    def test_validation_takes_its_share_of_the_core_time(self, tmp_path: Path) -> None:
        plan = Plan.of(journal_of(tmp_path, dict.fromkeys(range(30), 5.0)), None, LARGEST)
        assert plan is not None
        searched, validated = 30 * 3, 3 * plan.core_seconds
        assert validated == pytest.approx(SHARE * (searched + validated), rel=0.05)


def test_a_validation_of_other_results_is_refused(tmp_path: Path) -> None:
    """As where a journal was brought back from an older copy than the validation beside it."""
    journal = journal_of(tmp_path, dict.fromkeys(range(3), 5.0))
    for number, results, sound in ((2, 3, True), (2, 4, False), (2, 2, False), (9, 3, False)):
        Validation(results, (ResultLine((0, 0, number), 5, 9.0, {}, STAMPS),)).save(tmp_path)
        if sound:
            assert StudySummary.of(journal).incumbent is not None
            continue
        with pytest.raises(InvalidInput, match=r"validation.json in .* is of other results"):
            StudySummary.of(journal)


class TestValidation:
    def test_new_runs_for_the_same_core_time(self, tmp_path: Path) -> None:
        study = make_study(tmp_path)
        journal = Journal(study.folder)
        found, told = run_validation(study)
        assert found is not None
        assert found == Validation.load(study.folder)
        assert found.results == len(journal.results)
        plan = Plan.of(journal, None, study.schedule.budgets[-1])
        assert plan is not None
        assert {line.id for line in found.finalists} == set(plan.finalists)
        assert all(line.info["core_seconds"] >= plan.core_seconds for line in found.finalists)
        losses = [line.loss for line in found.finalists if line.loss is not None]
        assert losses == sorted(losses)
        assert len(losses) == len(found.finalists)
        assert [spent for spent, _ in told] == sorted(spent for spent, _ in told)
        assert all(0 <= spent <= total for spent, total in told)

    def test_no_run_of_the_search_counts(self, tmp_path: Path) -> None:
        study = make_study(tmp_path)
        found, _ = run_validation(study)
        assert found is not None
        for line in Journal(study.folder).configs:
            if line.id in {one.id for one in found.finalists}:
                old = ConfigurationRuns.read(study, line.id, line.configuration)
                new = ConfigurationRuns.read(study, line.id, line.configuration, validation=True)
                seeds = [{runs.run(i).seed for i in range(3)} for runs in (old, new)]
                assert not seeds[0] & seeds[1]
                (result,) = [one for one in found.finalists if one.id == line.id]
                assert (result.loss, result.info) == (new.tally.objective, new.tally.info)

    def test_finalists_keep_pace(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """The one that has spent least is the next, so that all can be compared at any time."""
        study = make_study(tmp_path)
        plan = Plan.of(Journal(study.folder), None, study.schedule.budgets[-1])
        assert plan is not None
        spent = dict.fromkeys(plan.finalists, 0.0)
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

    def test_too_little_time_leaves_what_was_there(self, tmp_path: Path) -> None:
        study = make_study(tmp_path)
        assert run_validation(study, lambda: True)[0] is None
        assert not (study.folder / VALIDATION_FILE).exists()
        found, _ = run_validation(study)
        assert found is not None
        shorter = replace(found, results=1)
        shorter.save(study.folder)
        for runs in study.folder.glob("configurations/*/validation-*/*"):
            runs.unlink()
        assert run_validation(study, lambda: True)[0] is None
        assert Validation.load(study.folder) == shorter

    def test_the_largest_budget_is_enough_for_a_comparison(self, tmp_path: Path) -> None:
        """On many cores the search has spent more than its finalists can in the time left."""
        study = make_study(tmp_path)
        journal, largest = Journal(study.folder), study.schedule.budgets[-1]
        plan = Plan.of(journal, None, study.schedule.budgets[-1])
        assert plan is not None
        spent: dict[str, float] = {}

        def progress(done: float, total: float) -> None:
            spent["each"] = done / len(plan.finalists)

        for times, enough in ((0.5, False), (1.5, True)):
            found = validate(
                study,
                journal,
                replace(plan, core_seconds=100 * largest),
                MadeUpPool(),
                lambda line: None,
                progress,
                lambda at_most=times * largest: spent.get("each", 0.0) >= at_most,  # type: ignore[misc]
            )
            assert (found is not None) == enough

    def test_interrupted_it_goes_on(self, tmp_path: Path) -> None:
        """It comes to the same, generation by generation."""
        whole, _ = run_validation(make_study(tmp_path / "whole"))
        study = make_study(tmp_path / "stopped")
        rounds = iter(range(5))
        run_validation(study, lambda: next(rounds, None) is None)
        rest, told = run_validation(study)
        assert whole is not None
        assert rest is not None
        assert told[0][0] > 0
        assert [(one.id, one.loss) for one in rest.finalists] == [
            (one.id, one.loss) for one in whole.finalists
        ]

    def test_repeated_from_disk_it_keeps_its_times(self, tmp_path: Path) -> None:
        """As after a stop in the retest that follows it."""
        study = make_study(tmp_path)
        found, _ = run_validation(study)
        assert found is not None
        assert run_validation(study)[0] == found == Validation.load(study.folder)
        earlier = replace(found, results=1)
        earlier.save(study.folder)
        assert run_validation(study)[0] != earlier

    def test_a_finalist_that_fails_is_left_out(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The others are compared all the same, also by the next process."""
        study = make_study(tmp_path)
        plan = Plan.of(Journal(study.folder), None, study.schedule.budgets[-1])
        assert plan is not None
        failing, advance = plan.finalists[0], ConfigurationRuns.advance

        def sometimes(runs: ConfigurationRuns, pool: EvaluationPool) -> NESState:
            if runs.id == failing:
                raise InvalidInput("agent 'mine' returned nothing")
            return advance(runs, pool)

        monkeypatch.setattr(ConfigurationRuns, "advance", sometimes)
        found, _ = run_validation(study)
        assert found is not None
        assert {line.id for line in found.finalists} == {*plan.finalists} - {failing}

        (study.folder / VALIDATION_FILE).unlink()
        for runs in study.folder.glob("configurations/*/validation-*/*"):
            runs.unlink()
        for failure in (StorageFailure("the disk is full"), OtherVersion("checkpoint", 1, 2)):

            def fails(
                runs: ConfigurationRuns, pool: EvaluationPool, failure: InvalidInput = failure
            ) -> NESState:
                raise failure

            monkeypatch.setattr(ConfigurationRuns, "advance", fails)
            with pytest.raises(type(failure)):
                run_validation(study)

    def test_damage_is_told(self, tmp_path: Path) -> None:
        (tmp_path / VALIDATION_FILE).write_text('{"results": 3}')
        with pytest.raises(InvalidInput, match="damaged validation"):
            Validation.load(tmp_path)


def test_the_winner_is_the_incumbent(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    journal = Journal(study.folder)
    before = StudySummary(journal)
    assert before.leader is not None
    assert before.incumbent == before.leader
    assert before.validation_table() == ""
    assert before.validated_points() == []
    found, _ = run_validation(study)
    assert found is not None
    reverse = replace(found, finalists=found.finalists[::-1])
    summary = StudySummary(journal, validation=reverse)
    assert summary.incumbent == found.finalists[-1]
    assert summary.leader == before.leader
    assert summary.validation_table().count("\n") == 2 + len(found.finalists)
    points = summary.validated_points()
    assert [point.objective for point in points] == [line.loss for line in reverse.finalists]
    searched = sum(journal.reached.values())
    assert {point.spent for point in points} == {
        searched + sum(line.budget for line in found.finalists)
    }
    for point, line in zip(points, reverse.finalists, strict=True):
        assert point.searched.objective == summary.result_of(line.id).loss
