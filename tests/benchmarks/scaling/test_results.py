"""The committed results: what was measured, what follows from it, what the page shows."""

import json
from dataclasses import replace

import pytest

from benchmarks.scaling import validation
from benchmarks.scaling.evaluations import columns, timed
from benchmarks.scaling.generations import GENERATION
from benchmarks.scaling.picture import PICTURE, picture, results_digest
from benchmarks.scaling.recorded import TASKS, load, recorded_run, varied_generations
from benchmarks.scaling.simulate import of_generations
from bilevel.evaluation import EvaluationRequest, evaluate
from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task


class TestMeasuring:
    def test_changes_no_evaluation(self, cartpole: Task, small_agent: DDQNHyperparameters) -> None:
        shape = Architecture(cartpole.state_size, cartpole.n_actions, 1, 8, "tanh")
        request = EvaluationRequest(3, 7, small_agent, start_seed=1)
        result = timed(cartpole, shape, None, request)
        plain = evaluate(cartpole, shape, None, request)
        assert replace(result, seconds=0.0) == replace(plain, seconds=0.0)
        assert result.seconds > 0
        row = columns(cartpole, [result])
        assert row["train_steps"] == [result.train_steps]
        # CartPole pays 1 a step.
        assert row["test_steps"] == [sum(result.test_returns)]

    @pytest.mark.parametrize("task", TASKS)
    def test_generations_are_whole(self, task: str) -> None:
        generations = [*recorded_run(task).generations]
        generations += [one.evaluations for one in varied_generations(task)]
        for one in generations:
            assert one.seconds.shape == one.train_steps.shape == (GENERATION,)
            assert (one.seconds > 0).all()


class TestSimulated:
    def test_agrees_with_the_real_pool(self) -> None:
        for row in validation.of_the_pool():
            assert row["simulated_seconds"] == pytest.approx(row["measured_seconds"], rel=0.05)
            assert row["forecast_seconds"] == pytest.approx(row["measured_seconds"], rel=0.1)

    def test_agrees_with_a_real_study_and_submits_the_same_jobs(self) -> None:
        line, study = validation.replayed_study()
        measured = {(tuple(job["id"]), job["budget"]) for job in study["jobs"]}
        assert {(job.id, job.budget) for job in line.jobs} == measured
        row = validation.of_the_study()
        assert row["simulated_seconds"] == pytest.approx(row["measured_seconds"], rel=0.05)

    @pytest.mark.parametrize("task", TASKS)
    def test_follows_from_what_was_measured(self, task: str) -> None:
        again = json.loads(json.dumps(of_generations(task)))
        assert again == load("simulated")["generations"][task]


class TestPicture:
    def test_is_of_these_results(self) -> None:
        assert results_digest() in PICTURE.read_text(), "run `python -m benchmarks.scaling.picture`"

    def test_has_a_line_for_each_case(self) -> None:
        distributions, efficiency, search = picture().axes
        result = load("simulated")
        cases = sum(len(result["generations"][task]["by_cores"]) for task in TASKS)
        assert len(distributions.lines) == cases
        assert len(efficiency.lines) == cases + 1  # and where evaluations end
        assert len(search.lines) == len({row["cores"] for row in result["search"]["splits"]})
