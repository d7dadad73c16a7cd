"""Brackets, journal and search, without Ray."""

import json
import math
import random
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import ConfigSpace as CS
import numpy as np
import pytest
from hpbandster.core.result import logged_results_to_HBS_result
from hypothesis import given, settings
from hypothesis import strategies as st

from bilevel import InvalidInput
from bilevel.hyperparameters import load_recipe
from bilevel.tasks import get_task
from cluster.bohb.brackets import (
    Schedule,
    budget_ladder,
    configurations_to_begin,
    core_seconds_to_run,
)
from cluster.bohb.importance import unit_values
from cluster.bohb.journal import Journal, Origin
from cluster.bohb.profiles import METHODS, get_profile, sized
from cluster.bohb.search import BracketSearch, Job
from cluster.bohb.study import Study
from cluster.bohb.summary import StudySummary
from cluster.storage.run_folder import locked_settings
from search_spaces.bohb import search_space
from search_spaces.prior import nearest
from search_spaces.space import Space
from search_spaces.translation import of_hyperparameters
from tests.studies import make_study, run_job

#: Hyperband's brackets.
LADDER = Schedule((1, 3, 9), 3)


class TestBrackets:
    @pytest.mark.parametrize(
        ("smallest", "largest", "ladder"),
        [
            (1, 243, [1, 3, 9, 27, 81, 243]),
            (2, 18, [2, 6, 18]),
            (7, 200, [7, 22, 67, 200]),
            (5, 5, [5]),
        ],
    )
    def test_ladder(self, smallest: int, largest: int, ladder: list[int]) -> None:
        assert budget_ladder(smallest, largest) == ladder

    @pytest.mark.parametrize(("smallest", "largest"), [(0, 3), (4, 3), (-1, -1)])
    def test_impossible_ladder(self, smallest: int, largest: int) -> None:
        with pytest.raises(InvalidInput, match="budgets must satisfy"):
            budget_ladder(smallest, largest)

    @given(st.integers(1, 60), st.integers(0, 7))
    def test_sizes_equal_hpbandsters(self, smallest: int, exponent: int) -> None:
        """hpbandster's own formula, for the ladders on which its logarithm is right."""
        import numpy as np

        ladder = budget_ladder(smallest, smallest * 3**exponent)
        assert len(ladder) == exponent + 1
        for bracket in range(exponent + 2):
            s = len(ladder) - 1 - bracket % len(ladder)
            first = int(np.floor(len(ladder) / (s + 1)) * 3**s)
            # It rounds down a power of 3, whose last bits are not to count.
            expected = [max(int(first * 3.0**-i + 1e-9), 1) for i in range(s + 1)]
            rungs = Schedule(tuple(ladder), len(ladder)).bracket(bracket)
            assert [rung.configurations for rung in rungs] == expected
            assert [rung.budget for rung in rungs] == ladder[-s - 1 :]

    def test_random_search_has_the_largest_budget_alone(self) -> None:
        assert Schedule.of("random", 1, 9) == Schedule((9,), 1)
        assert Schedule.of("random", 1, 9, cycle=2) == Schedule((9,), 1)
        for method in ("hyperband", "bohb"):
            assert Schedule.of(method, 1, 9) == Schedule((1, 3, 9), 3)
            assert Schedule.of(method, 1, 9, cycle=2) == Schedule((1, 3, 9), 2)

    def test_in_a_cycle_of_one_all_begin_at_the_smallest_budget(self) -> None:
        rungs = Schedule((3, 9), 1).brackets(3)
        assert [(r.bracket, r.configurations, r.budget) for r in rungs] == [
            *((0, 3, 3), (0, 1, 9)),
            *((1, 3, 3), (1, 1, 9)),
            *((2, 3, 3), (2, 1, 9)),
        ]
        assert core_seconds_to_run(rungs) == 3 * (3 * 3 + 6)

    @pytest.mark.parametrize("cycle", [0, 3])
    def test_impossible_cycle(self, cycle: int) -> None:
        with pytest.raises(InvalidInput, match=f"must be 1 to 2 .*; got {cycle}"):
            Schedule((3, 9), cycle)

    @pytest.mark.parametrize(("brackets", "begun"), [(1, 9), (2, 12), (3, 15), (4, 24)])
    def test_configurations_are_counted_once(self, brackets: int, begun: int) -> None:
        assert configurations_to_begin(LADDER.brackets(brackets)) == begun

    def test_promoted_configurations_continue(self) -> None:
        table = Schedule((2, 6, 18), 3).brackets(3)
        assert core_seconds_to_run(table) == (9 * 2 + 3 * 4 + 12) + (3 * 6 + 12) + 3 * 18


def loss_of(job: Job) -> float:
    """A smooth function of the configuration with a clear optimum."""
    from math import log

    values = job.configuration
    step, limit = values["nes.step_size"], values["se.step_limit"]
    return log(step / 0.2) ** 2 + log(limit / 20) ** 2 - 0.01 * job.budget


def new_search(folder: Path, brackets: int = 6, seed: int = 0) -> BracketSearch:
    return BracketSearch(search_space("core"), LADDER, brackets, seed, Journal(folder))


def run_to_end(search: BracketSearch, fail: tuple[int, ...] = ()) -> list[Job]:
    jobs: list[Job] = []
    while (job := search.next_job()) is not None:
        search.register(job, None if len(jobs) in fail else loss_of(job))
        jobs.append(job)
    assert search.finished
    return jobs


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[Job]:
    """The jobs of a search that was never interrupted."""
    return run_to_end(new_search(tmp_path_factory.mktemp("whole")))


@dataclass(frozen=True)
class LongSearch:
    """A search in which the model has learned."""

    journal: Journal
    jobs: list[Job]


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> LongSearch:
    search = new_search(folder := tmp_path_factory.mktemp("long"), brackets=15)
    jobs = run_to_end(search)
    return LongSearch(Journal(folder), jobs)


class TestStudy:
    @pytest.fixture
    def study(self, tmp_path: Path) -> Study:
        task = get_task("CartPole-v0")
        base = sized(load_recipe("default", task.id), get_profile("local"))
        schedule = Schedule((1, 3), 2)
        study = Study(tmp_path / "study", task, 3, Space("core"), schedule, base, "hyperband")
        with locked_settings(study.folder, study.settings()):
            return study

    def test_is_what_its_folder_says(self, study: Study) -> None:
        assert Study.read(study.folder) == study

    @pytest.mark.parametrize("method", METHODS)
    def test_bohb_alone_asks_the_model(self, method: str, study: Study, tmp_path: Path) -> None:
        study = replace(study, method=method)
        jobs = run_to_end(BracketSearch.of(study, Journal(tmp_path), 12))
        assert any(job.origin is Origin.MODEL for job in jobs) == (method == "bohb")

    def test_starts_are_each_runs_own(self, study: Study) -> None:
        """Starts depend on the study's seed, the configuration's id and the number of the run."""
        runs = [study.run((0, 0, of), {}, number) for of in range(3) for number in range(2)]
        assert len({run.seed for run in runs}) == 6
        assert study.run((0, 0, 1), {"se.hidden_size": 16}, 0).seed == runs[2].seed
        assert replace(study, seed=4).run((0, 0, 1), {}, 0).seed != runs[2].seed

    def test_a_configuration_changes_what_it_names(self, study: Study) -> None:
        hp = study.run((0, 0, 0), {"se.hidden_size": 16, "nes.population_size": 9}, 0).hp
        assert (hp.se.hidden_size, hp.nes.population_size) == (16, 9)
        assert replace(hp, se=study.base.se, nes=study.base.nes) == study.base
        assert replace(hp.nes, population_size=study.base.nes.population_size) == study.base.nes

    def test_steps_on_the_real_task_are_counted_through(self, study: Study) -> None:
        """The count includes the scale of observations and the choice of a start."""
        job = Job((0, 0, 0), {"nes.population_size": 2}, 3, Origin.RANDOM, 0.0)
        run_job(study, job)
        run = study.run(job.id, job.configuration, 0)
        state, begun = run.load(), run.nes.init()
        assert state is not None
        assert begun.race is not None
        before = begun.real_env_steps + 40 * begun.race.evaluations
        evaluations = run.hp.nes.evaluations
        counted = [record.real_env_steps for record in state.records]
        assert len(counted) > 3
        assert counted == [before + 40 * evaluations * (n + 1) for n in range(len(counted))]


def test_a_trial_starts_without_what_proposes() -> None:
    """The imports of hpbandster and ConfigSpace take longer than a trial's own."""
    proposing = "{'hpbandster', 'ConfigSpace'}"
    code = f"import sys, cluster.bohb.tune.trial; sys.exit(bool({proposing} & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", code], check=True)


class TestSearch:
    def test_runs_the_bracket_table(self, whole: list[Job]) -> None:
        for rung in LADDER.brackets(6):
            count = sum(job.id[0] == rung.bracket and job.budget == rung.budget for job in whole)
            assert count == rung.configurations

    def test_promotes_the_best(self, tmp_path: Path) -> None:
        jobs = run_to_end(new_search(tmp_path, brackets=1))
        lowest = sorted((job for job in jobs if job.budget == 1), key=loss_of)
        assert {job.id for job in jobs if job.budget == 3} == {job.id for job in lowest[:3]}

    def test_model_based_picks_happen_and_help(self, long: LongSearch) -> None:
        firsts = {job.id: job for job in reversed(long.jobs)}.values()
        model = [loss_of(job) for job in firsts if job.origin is Origin.MODEL]
        rand = [loss_of(job) for job in firsts if job.origin is not Origin.MODEL]
        assert len(model) >= 10
        assert sum(model) / len(model) < 0.7 * sum(rand) / len(rand)

    def test_failures_count_as_worst_and_are_not_promoted(self, tmp_path: Path) -> None:
        search = new_search(tmp_path, brackets=1)
        jobs = run_to_end(search, fail=tuple(range(8)))
        assert len(jobs) == 9 + 3 + 1  # empty places are filled with new configurations
        failed = {job.id for job in jobs[:8]}
        assert not any(job.id in failed for job in jobs if job.budget > 1)
        assert sum(line.loss is None for line in Journal(tmp_path).results) == 8

    def test_seed_decides(self, whole: list[Job], tmp_path: Path) -> None:
        again = run_to_end(new_search(tmp_path / "again"))
        other = run_to_end(new_search(tmp_path / "other", brackets=1, seed=1))
        assert [job.configuration for job in again] == [job.configuration for job in whole]
        assert other[0].configuration != whole[0].configuration

    @pytest.mark.parametrize("seed", range(8))
    def test_interrupted_anywhere_it_goes_on_the_same(
        self, seed: int, whole: list[Job], tmp_path: Path
    ) -> None:
        """A search that is killed after any number of results, with or without a job in flight,
        resumes from its journal with the same results."""
        chance = random.Random(seed)
        search = new_search(tmp_path / "parts")
        done: list[Job] = []
        while (job := search.next_job()) is not None:
            if chance.random() < 0.3:
                search = new_search(tmp_path / "parts")
                continue
            search.register(job, loss_of(job))
            done.append(job)
            if chance.random() < 0.2:
                search = new_search(tmp_path / "parts")
        assert search.finished
        assert [(j.id, j.budget, j.configuration) for j in done] == [
            (j.id, j.budget, j.configuration) for j in whole
        ]

    def test_more_brackets_use_all_that_came_before(self, tmp_path: Path) -> None:
        run_to_end(new_search(tmp_path, brackets=6))
        more = run_to_end(new_search(tmp_path, brackets=9))
        assert {job.id[0] for job in more} == {6, 7, 8}
        assert any(job.origin is Origin.MODEL for job in more)


def test_a_space_with_conditions_is_searched_the_same_again(tmp_path: Path) -> None:
    """hpbandster draws values for inactive hyperparameters when it learns of a result."""
    space = CS.ConfigurationSpace()
    kind = CS.Categorical("nes.shared_agent", [True, False])
    only_if = CS.Float("nes.std_dev", (0.01, 1.0), log=True)
    always = CS.Float("nes.step_size", (0.01, 1.0), log=True)
    space.add(kind, only_if, always)
    space.add(CS.EqualsCondition(only_if, kind, True))

    def loss(job: Job) -> float:
        return abs(math.log(job.configuration["nes.step_size"] / 0.1))

    def search(name: str, brackets: int) -> BracketSearch:
        return BracketSearch(space, LADDER, brackets, 3, Journal(tmp_path / name))

    for name, stops in (("one", [8]), ("again", [8]), ("resumed", [3, 5, 8])):
        for brackets in stops:
            np.random.seed(len(name) + brackets)  # a global generator must not matter
            run = search(name, brackets)
            while (job := run.next_job()) is not None:
                run.register(job, loss(job))
    found = [
        [(line.id, line.configuration) for line in Journal(tmp_path / name).configs]
        for name in ("one", "again", "resumed")
    ]
    assert found[0] == found[1] == found[2]
    assert any(line.origin is Origin.MODEL for line in Journal(tmp_path / "one").configs)


class TestPrior:
    def test_the_search_begins_with_it_and_stays_near_it_half_of_the_time(
        self, tmp_path: Path
    ) -> None:
        space = search_space("core")
        prior = nearest(space, of_hyperparameters(load_recipe("default", "CartPole-v0"), space))
        schedule, journal = Schedule((1,), 1), Journal(tmp_path)
        search = BracketSearch(space, schedule, 200, 0, journal, model=False, prior=prior)
        jobs = run_to_end(search)
        assert jobs[0].configuration == prior
        origins = {job.origin for job in jobs[1:]}
        assert jobs[0].origin is Origin.RECIPE
        assert origins == {Origin.AROUND_RECIPE, Origin.RANDOM}
        drawn = [bool(line.info.get("prior")) for line in journal.configs]
        assert 70 < sum(drawn) < 130

        def distance(values: dict[str, Any]) -> float:
            """Mean over the dimensions, in units of their ranges."""
            return float(np.abs(unit_values(space, values) - unit_values(space, prior)).mean())

        distances = np.array([distance(line.configuration) for line in journal.configs])
        near, far = distances[drawn].mean(), distances[~np.array(drawn)].mean()
        assert near < 0.15 < 0.2 < far
        again = BracketSearch(space, schedule, 200, 0, Journal(tmp_path), model=False, prior=prior)
        assert again.next_job() is None  # all of it is in the journal

    def test_values_out_of_the_space_become_the_nearest(self) -> None:
        space = search_space("core")
        hp = load_recipe("default", "CartPole-v0")
        wide = of_hyperparameters(
            replace(hp, nes=replace(hp.nes, std_dev=9.0), se=replace(hp.se, hidden_size=1000)),
            space,
        )
        found = nearest(space, wide)
        assert (found["nes.std_dev"], found["se.hidden_size"]) == (1.0, 64)
        assert type(found["se.hidden_size"]) is int
        CS.Configuration(space, values=found)  # raises for one that is not in it


@pytest.fixture(scope="module")
def earlier_study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A study of which the model can learn."""
    return make_study(tmp_path_factory.mktemp("study") / "earlier-one", brackets=12)


class TestEarlierResults:
    """A study that begins with the results of another one."""

    @pytest.fixture
    def study(self, earlier_study: Study, tmp_path: Path) -> Study:
        shutil.copytree(earlier_study.folder, tmp_path / "earlier-one")
        return replace(
            earlier_study, folder=tmp_path / "later", prior="earlier-one", seed=5, schedule=LADDER
        )

    def test_the_model_proposes_at_once_and_better(self, long: LongSearch, tmp_path: Path) -> None:
        space, journal = search_space("core"), Journal(tmp_path / "later")
        search = BracketSearch(space, LADDER, 1, 7, journal, earlier=long.journal)
        jobs = run_to_end(search)
        assert any(job.origin is Origin.MODEL for job in jobs[:5])
        alone = run_to_end(new_search(tmp_path / "alone", brackets=1, seed=7))
        losses = [np.mean([loss_of(job) for job in found]) for found in (jobs, alone)]
        assert losses[0] < losses[1]

    def test_a_model_of_larger_budgets_does_not_drown_the_search(
        self, long: LongSearch, tmp_path: Path
    ) -> None:
        """hpbandster's model of the largest budget proposes, and takes no results of lower ones."""
        space = search_space("core")
        assert max(line.budget for line in long.journal.results) == 9
        found = []
        for prior in (long.journal, None):
            journal = Journal(tmp_path / f"later-{prior is None}")
            search = BracketSearch(space, Schedule((1,), 1), 30, 7, journal, earlier=prior)
            run_to_end(search)
            models = search._generator.kde_models
            assert set(models) == {1}
            found.append(search._generator.losses[1])
        assert len(found[0]) > len(found[1]) == 30

    def test_results_are_copied_before_their_configurations(
        self, study: Study, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The other study may be under way: a result needs its configuration."""
        copied: list[str] = []
        monkeypatch.setattr(
            "cluster.bohb.study.write_aside", lambda path, _: copied.append(path.name)
        )
        with pytest.raises(FileNotFoundError):  # nothing was written
            study.take_over_prior()
        assert copied == ["results.json", "configs.json"]

    def test_they_are_copied(self, study: Study) -> None:
        """What becomes of the other study does not matter then."""
        study.check_prior()
        study.take_over_prior()
        assert study.earlier is not None
        other = study.folder.parent / study.prior
        assert study.earlier.results == Journal(other).results
        shutil.rmtree(other)
        study.check_prior()
        study.take_over_prior()
        search = BracketSearch.of(study, Journal(study.folder), 1)
        found = [search.next_job() for _ in range(9)]
        assert any(job is not None and job.origin is Origin.MODEL for job in found)

    def test_those_that_do_not_fit_are_refused(self, study: Study) -> None:
        unknown = replace(study, prior="unknown")
        with pytest.raises(InvalidInput, match=r"unknown prior 'unknown': .*studies on the same"):
            unknown.check_prior()
        with pytest.raises(InvalidInput, match="'earlier-one' cannot be the prior: it searched an"):
            replace(study, space=Space("full")).check_prior()
        with pytest.raises(InvalidInput, match="prior of the method 'random': only bohb has a"):
            replace(study, method="random").check_prior()
        large = replace(study, schedule=Schedule((10, 30), 1))
        with pytest.raises(InvalidInput, match="it has no results at the budgets 10, 30"):
            large.check_prior()
        for path in Journal(study.folder.parent / study.prior).paths:
            path.unlink()
        with pytest.raises(InvalidInput, match="'earlier-one' cannot be the prior: it has no res"):
            study.check_prior()
        assert not study.folder.exists()


class TestSummary:
    def test_of_a_whole_study(self, tmp_path: Path) -> None:
        jobs = run_to_end(new_search(tmp_path, brackets=4), fail=(1,))
        journal = Journal(tmp_path)
        summary = StudySummary(journal, LADDER.brackets(4))
        best = min((job for job in jobs if job.budget == 9), key=loss_of)
        assert summary.incumbent is not None
        assert summary.incumbent.id == best.id
        assert summary.configuration(best.id) == best.configuration
        points = summary.points()
        assert len(points) == len(jobs) - 1  # one failed
        assert points[-1].spent == core_seconds_to_run(LADDER.brackets(4))
        assert summary.core_seconds_left() == 0
        assert summary.bracket_table().count("\n") == 2 + len(LADDER.brackets(4))

    def test_of_nothing(self, tmp_path: Path) -> None:
        summary = StudySummary(Journal(tmp_path), Schedule((1, 3), 2).brackets(1))
        assert summary.incumbent is None
        assert summary.points() == []
        assert summary.core_seconds_left() == 3 + 2


class TestJournal:
    def test_hpbandster_reads_it(self, tmp_path: Path) -> None:
        jobs = run_to_end(new_search(tmp_path), fail=(2,))
        result = logged_results_to_HBS_result(str(tmp_path))
        assert len(result.get_all_runs()) == len(jobs)
        best = min((j for j in jobs if j.budget == 9), key=loss_of)
        assert result.get_incumbent_id() == best.id

    @given(cut=st.integers(1, 60))
    @settings(max_examples=30)
    def test_a_torn_last_line_is_dropped(
        self, cut: int, tmp_path_factory: pytest.TempPathFactory
    ) -> None:
        folder = tmp_path_factory.mktemp("journal")
        run_to_end(new_search(folder, brackets=1))
        path = folder / "results.json"
        content = path.read_bytes()
        last = content[:-1].rfind(b"\n") + 1
        path.write_bytes(content[: max(len(content) - cut, last)])
        torn = path.read_bytes()
        assert len(Journal(folder).results) == 12
        assert path.read_bytes() == torn  # reading does not change the file
        run_to_end(new_search(folder, brackets=1))
        assert len(Journal(folder).results) == 13

    @pytest.mark.parametrize("line", ["{}", "[1]", '[[0,0,0],"x",{},{}]', "nonsense", "[[0,0,0]]"])
    def test_damage_in_the_middle_is_told(self, line: str, tmp_path: Path) -> None:
        run_to_end(new_search(tmp_path, brackets=1))
        path = tmp_path / "configs.json"
        lines = path.read_text().splitlines()
        path.write_text("\n".join([lines[0], line, *lines[1:]]) + "\n")
        with pytest.raises(InvalidInput, match="damaged file"):
            Journal(tmp_path)

    @given(data=st.data())
    @settings(max_examples=60, deadline=None)
    def test_a_configuration_outside_the_space_is_told(
        self, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
    ) -> None:
        folder = tmp_path_factory.mktemp("journal")
        run_to_end(new_search(folder, brackets=1))
        path = folder / "configs.json"
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        values = data.draw(st.sampled_from(lines))[1]
        name = data.draw(st.sampled_from([*values, "nes.unknown"]))
        wrong = st.none() | st.text() | st.lists(st.integers()) | st.just(-1.0) | st.just(1e9)
        values[name] = data.draw(wrong | st.just(float("nan")))
        path.write_text("".join(json.dumps(line) + "\n" for line in lines))
        with pytest.raises(InvalidInput, match="damaged journal"):
            new_search(folder, brackets=1)
