"""The simulations against closed forms, bounds, and the product's own bracket table."""

import math
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.scaling.simulation import (
    JobCourse,
    PoolOverhead,
    SearchTimeline,
    StudyOverhead,
    simulate_pool,
    simulate_search,
)
from cluster.bohb.brackets import Schedule, generations_to_run
from cluster.bohb.journal import Journal
from cluster.bohb.search import BracketSearch, Job
from cluster.bohb.searcher import BohbSearcher
from search_spaces import search_space

durations = st.lists(st.floats(0.01, 100.0), min_size=1, max_size=60)
cores = st.integers(1, 70)


class TestPool:
    @given(st.integers(1, 200), cores, st.floats(0.1, 10.0))
    def test_identical_evaluations(self, n: int, c: int, seconds: float) -> None:
        line = simulate_pool([seconds] * n, c)
        assert line.seconds == pytest.approx(math.ceil(n / c) * seconds)
        assert line.efficiency == pytest.approx(n / (c * math.ceil(n / c)))

    @given(durations)
    def test_one_core_takes_the_sum(self, seconds: list[float]) -> None:
        line = simulate_pool(seconds, 1)
        assert line.seconds == pytest.approx(sum(seconds))
        assert line.straggler_share == pytest.approx(0.0, abs=1e-9)

    @given(durations)
    def test_a_core_each_takes_the_longest(self, seconds: list[float]) -> None:
        line = simulate_pool(seconds, len(seconds) + 5)
        assert line.seconds == pytest.approx(max(seconds))
        mean = sum(seconds) / len(seconds)
        assert line.straggler_share == pytest.approx(1 - mean / max(seconds))

    @given(durations, cores)
    def test_lies_between_the_bounds(self, seconds: list[float], c: int) -> None:
        """At least the longest and the cores' even share; at most Graham's (1966)
        bound, which any list scheduling keeps."""
        line = simulate_pool(seconds, c)
        even, longest = sum(seconds) / c, max(seconds)
        assert line.seconds >= max(even, longest) * (1 - 1e-9)
        assert line.seconds <= (even + (1 - 1 / c) * longest) * (1 + 1e-9)

    @given(st.lists(st.floats(0.1, 10.0), min_size=1, max_size=7), st.integers(1, 3))
    @settings(max_examples=50)
    def test_longest_first_is_near_the_best_schedule(self, seconds: list[float], c: int) -> None:
        """Graham (1969): within 4/3 - 1/(3c) of the best of all assignments."""
        best = min(
            max(
                sum(t for t, core in zip(seconds, cores_of, strict=True) if core == k)
                for k in range(c)
            )
            for cores_of in product(range(c), repeat=len(seconds))
        )
        line = simulate_pool(sorted(seconds, reverse=True), c)
        assert best * (1 - 1e-9) <= line.seconds <= best * (4 / 3 - 1 / (3 * c)) * (1 + 1e-9)

    def test_order_counts(self) -> None:
        assert simulate_pool([1, 1, 2], 2).seconds == 3
        assert simulate_pool([2, 1, 1], 2).seconds == 2

    @given(st.integers(1, 50), st.floats(0.1, 1.0), st.floats(0.0, 0.1), st.floats(0.0, 0.1))
    def test_overhead_of_one_actor_adds_up(
        self, n: int, seconds: float, driver: float, actor: float
    ) -> None:
        line = simulate_pool([seconds] * n, 1, PoolOverhead(driver, actor))
        assert line.seconds == pytest.approx(n * (seconds + driver + actor))

    def test_the_driver_bounds_any_number_of_actors(self) -> None:
        line = simulate_pool([0.01] * 1000, 500, PoolOverhead(driver=0.002))
        assert line.seconds == pytest.approx(1000 * 0.002 + 0.01)


def simulate(
    folder: Path,
    trials: int,
    budgets: tuple[int, ...],
    brackets: int,
    generation_seconds: float = 1.0,
    overhead: StudyOverhead | None = None,
) -> SearchTimeline:
    """Every generation takes the same; the loss is the configuration's number."""
    schedule = Schedule(budgets, len(budgets))
    search = BracketSearch(search_space("core"), schedule, brackets, 0, Journal(folder))
    reached: dict[tuple[int, int, int], int] = {}

    def course(job: Job) -> JobCourse:
        left = job.budget - reached.get(job.id, 0)
        reached[job.id] = job.budget
        return JobCourse([generation_seconds] * left, [generation_seconds] * left, job.id[2])

    searcher = BohbSearcher(search, lambda: trials, float("inf"))
    line = simulate_search(searcher, trials, course, overhead)
    assert search.finished
    return line


class TestSearch:
    @pytest.mark.parametrize("trials", [1, 3, 40])
    def test_runs_the_bracket_table(self, trials: int, tmp_path: Path) -> None:
        line = simulate(tmp_path, trials, (1, 3, 9), 4)
        table = Schedule((1, 3, 9), 3).brackets(4)
        for rung in table:
            jobs = [j for j in line.jobs if j.id[0] == rung.bracket and j.budget == rung.budget]
            assert len(jobs) == rung.configurations
        assert line.busy == generations_to_run(table)

    def test_one_trial_takes_the_sum(self, tmp_path: Path) -> None:
        line = simulate(tmp_path, 1, (1, 3, 9), 3, 2.0)
        assert line.seconds == 2.0 * generations_to_run(Schedule((1, 3, 9), 3).brackets(3))
        assert line.efficiency == 1.0

    def test_any_number_of_trials_takes_the_longest_chain(self, tmp_path: Path) -> None:
        line = simulate(tmp_path, 1000, (1, 3, 9), 3)
        assert line.seconds == 9.0

    def test_one_bracket_waits_for_its_rungs(self, tmp_path: Path) -> None:
        line = simulate(tmp_path, 4, (1, 3), 1)  # 3 configurations, the best one goes on
        assert [(job.id[2], job.budget) for job in line.jobs] == [(0, 1), (1, 1), (2, 1), (0, 3)]
        assert line.seconds == 1.0 + 2.0
        assert line.efficiency == pytest.approx((3 * 1.0 + 2.0) / (4 * 3.0))

    def test_the_driver_does_one_thing_at_a_time(self, tmp_path: Path) -> None:
        one = simulate(tmp_path / "1", 1, (1, 3, 9), 2, 1.0, StudyOverhead(0.5, 0.25))
        rungs = Schedule((1, 3, 9), 3).brackets(2)
        jobs, generations = sum(r.configurations for r in rungs), generations_to_run(rungs)
        assert one.driver == pytest.approx(0.5 * jobs + 0.25 * generations)
        assert one.seconds == pytest.approx(one.driver + generations)
        many = simulate(tmp_path / "2", 100, (1, 3, 9), 2, 1e-6, StudyOverhead(0.5, 0.25))
        assert many.seconds == pytest.approx(many.driver, rel=1e-3)

    def test_how_long_things_take_changes_nothing_of_what_is_run(self, tmp_path: Path) -> None:
        one = simulate(tmp_path / "1", 1, (1, 3, 9), 2)
        two = simulate(tmp_path / "2", 1, (1, 3, 9), 2, 7.0, StudyOverhead(1.0, 1.0))
        assert [(j.id, j.budget, j.configuration) for j in one.jobs] == [
            (j.id, j.budget, j.configuration) for j in two.jobs
        ]
