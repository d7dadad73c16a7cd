"""`bilevel bohb` on real Ray and MLflow."""

import os
import re
import shutil
import signal
from pathlib import Path

import ConfigSpace as CS
import mlflow.entities
import pytest

from bilevel.nes import NES
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from cluster.bohb.finish import INCUMBENT_SE_FILE
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import Validation
from cluster.bohb.study.definition import RECIPE_FILE, SPACE_FILE, Study, configuration_name
from cluster.bohb.study.journal import Journal
from cluster.storage.run_folder import BEST_FILE, LAST_FILE
from search_spaces.bohb import search_space
from tests.commands import run_bilevel
from tests.faults.stage import ONE_BY_ONE
from tests.system.conftest import client, run_until

pytestmark = pytest.mark.timeout(290)

SMOKE = (
    *("bohb", "CartPole-v0", "--profile", "smoke", "--study", "smoke", "--brackets", "1"),
    *("--set", "nes.centre_agents=2", "--set", "nes.patient_episodes=0", "--vary-hp", "no"),
    *("--set", "ddqn.hidden_size=16", "--set", "ddqn.batch_size=16"),
)


def results(home: Path, study: str = "smoke") -> dict[object, float | None]:
    journal = Journal(home / "CartPole-v0" / study)
    return {(line.id, line.budget): line.loss for line in journal.results}


def tracked_runs(home: Path) -> list[mlflow.entities.Run]:
    """Runs of the task's experiment in MLflow."""
    experiment = client(home).get_experiment_by_name("CartPole-v0")
    assert experiment is not None
    return list(client(home).search_runs([experiment.experiment_id]))


@pytest.fixture(scope="module")
def study_home(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The home of a smoke study, run once, and its output."""
    home = tmp_path_factory.mktemp("home")
    result = run_bilevel(*SMOKE, "--home", home)
    assert result.returncode == 0, result.stderr
    return home, result.stdout


def test_every_layer_ran(study_home: tuple[Path, str]) -> None:
    home, output = study_home
    assert len(results(home)) == 4
    assert re.search(r"000-0-00\d (none confirmed|\d SEs?) in [34] core s", output)
    assert "too short for a validation" in output
    study = Study.read(home / "CartPole-v0" / "smoke")
    assert (study.folder / SPACE_FILE).exists()
    journal = Journal(study.folder)
    runs = [
        ConfigurationRuns(study, line.id, line.configuration).read() for line in journal.configs
    ]
    assert sorted(int(each.tally.cost) for each in runs) == [1, 1, 3]
    learned = sum(state.real_env_steps for each in runs for state in each.states)
    counted = load_se(study.folder / BEST_FILE).info["real_env_steps"]
    assert counted > learned > 0  # with the retests
    assert f"{counted} steps on the real task in all runs" in output


def test_mlflow_has_a_parent_run_and_a_child_per_configuration(
    study_home: tuple[Path, str],
) -> None:
    home, _ = study_home
    mlflow_client, runs = client(home), tracked_runs(home)
    assert {run.info.status for run in runs} == {"FINISHED"}
    (parent,) = [run for run in runs if "mlflow.parentRunId" not in run.data.tags]
    children = [run for run in runs if run is not parent]
    assert len(children) == 3
    assert parent.data.metrics["final_score_mean"] > 0
    assert parent.data.params["base.nes.centre_agents"] == "2"
    names = {file.path for file in mlflow_client.list_artifacts(parent.info.run_id)}
    tables = {"objective_against_cost.png", "brackets.csv", "incumbent.json", "results.csv"}
    assert {*tables, RECIPE_FILE, BEST_FILE, "journal"} <= names
    best = mlflow_client.get_model_version_by_alias("SE-CartPole-v0", "best")
    assert best.run_id == parent.info.run_id
    for child in children:
        data, id = child.data, child.info.run_id
        assert data.tags["mlflow.parentRunId"] == parent.info.run_id
        assert set(data.params) == set(search_space("core"))
        history = mlflow_client.get_metric_history(id, "score_mean")
        assert [metric.step for metric in history] == list(range(len(history)))
        metrics = data.metrics
        assert metrics["core_seconds"] == pytest.approx(metrics["budget"], abs=1)
        files = {file.path for file in mlflow_client.list_artifacts(id)}
        assert files >= {BEST_FILE, LAST_FILE, "configuration.json", "learning_curve.png"}


def test_the_same_command_adds_brackets(
    study_home: tuple[Path, str], tmp_home: Path, address: str
) -> None:
    """Two brackets are enough for a validation."""
    home = tmp_home
    shutil.copytree(study_home[0] / "CartPole-v0", home / "CartPole-v0")
    result = run_bilevel(*SMOKE, *ONE_BY_ONE, "--home", home, "--address", address)
    assert result.returncode == 0, result.stderr
    assert "resuming 3 configurations with 4 results" in result.stdout
    before, after = results(study_home[0]), results(home)
    assert len(after) == 6
    assert before.items() <= after.items()

    output, study = result.stdout, Study.read(home / "CartPole-v0" / "smoke")
    assert "validating 2 configurations with new seeds" in output
    assert len(re.findall(r"with new seeds; objective \d+ \(in the search \d+\)", output)) == 2
    assert "too short for a validation" not in output
    validation = Validation.load(study.folder)
    assert validation is not None
    assert validation.results == 6
    winner = configuration_name(validation.finalists[0].id)
    assert f"incumbent {winner} (" in output
    assert f"configuration {winner}\n" in (study.folder / RECIPE_FILE).read_text()
    (parent,) = [r for r in tracked_runs(home) if "mlflow.parentRunId" not in r.data.tags]
    assert parent.data.metrics["validated_objective"] == validation.finalists[0].loss
    assert parent.data.tags["bilevel.incumbent"] == winner
    files = {file.path for file in client(home).list_artifacts(parent.info.run_id)}
    assert "validation.csv" in files


def test_a_study_resumes_after_ctrl_c_with_the_same_results(
    study_home: tuple[Path, str], tmp_home: Path, address: str
) -> None:
    """The uninterrupted study had one worker in each of two trials."""
    process = run_until("; objective ", *SMOKE, "--home", tmp_home)
    os.killpg(process.pid, signal.SIGINT)  # to everyone, as a terminal does
    rest, _ = process.communicate(timeout=90)
    assert process.returncode == 130
    assert "run the same command again to resume" in rest
    assert "incumbent 00" in rest
    folder = tmp_home / "CartPole-v0" / "smoke"
    assert (folder / RECIPE_FILE).exists()
    assert load_se(folder / INCUMBENT_SE_FILE).info
    assert 1 <= len(results(tmp_home)) < 4
    runs = tracked_runs(tmp_home)
    assert "RUNNING" not in {r.info.status for r in runs}
    assert "KILLED" in {r.info.status for r in runs}

    args = ("--workers-per-trial", "2", *ONE_BY_ONE, "--address", address)
    result = run_bilevel(*SMOKE, *args, "--home", tmp_home)
    assert result.returncode == 0, result.stderr
    assert results(tmp_home) == results(study_home[0])
    runs = tracked_runs(tmp_home)
    assert len(runs) == 4
    assert {r.info.status for r in runs} == {"FINISHED"}
    for tracked in runs:
        history = client(tmp_home).get_metric_history(tracked.info.run_id, "score_mean")
        assert [metric.step for metric in history] == list(range(len(history)))


def test_time_budget_ends_the_search(
    study_home: tuple[Path, str], tmp_home: Path, address: str
) -> None:
    """The number of results depends on the machine and may be 0. The study was stopped before its
    first result."""
    shutil.copytree(study_home[0] / "CartPole-v0", tmp_home / "CartPole-v0")
    (tmp_home / "CartPole-v0" / "smoke" / "results.json").unlink()
    args = ("--brackets", "99", "--time-budget", "10s", "--address", address)
    result = run_bilevel(*SMOKE, *args, "--home", tmp_home)
    assert "resuming 3 configurations with 0 results" in result.stdout
    assert "the search has reached its time limit" in result.stdout
    assert "/99" not in result.stdout  # brackets that the study will not reach
    scored = "fresh agents trained on the best SE" in result.stdout
    assert result.returncode == (0 if scored else 1), result.stderr
    assert "Traceback" not in result.stderr


def test_a_failing_trial_ranks_last_and_the_study_continues(
    tmp_home: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The checkpoint of a configuration has another format."""
    run = tmp_home / "CartPole-v0" / "smoke" / "configurations" / "000-0-001" / "run-0"
    run.mkdir(parents=True)
    nes = NES(get_task("CartPole-v0"), load_recipe("default", "CartPole-v0"))
    monkeypatch.setattr("bilevel.nes.checkpoint.RUN_FORMAT", 99)
    nes.save(nes.init(), run / "state.safetensors")
    result = run_bilevel(*SMOKE, *ONE_BY_ONE, "--home", tmp_home, "--address", address)
    assert result.returncode == 0, result.stderr
    assert "000-0-001 failed: " in result.stdout
    losses = results(tmp_home)
    assert len(losses) == 4
    assert losses[(0, 0, 1), 1] is None
    (failed,) = [r for r in tracked_runs(tmp_home) if r.info.status == "FAILED"]
    assert failed.info.run_name == "000-0-001"
    assert "has format 99" in failed.data.tags["bilevel.error"]


def test_a_study_without_an_se_ends_with_1(tmp_home: Path, address: str) -> None:
    """The budget ends before the first generation."""
    space = tmp_home / "mine.json"
    CS.ConfigurationSpace(space=[CS.Constant("nes.start_candidates", 1000)]).to_json(space)
    options = (*ONE_BY_ONE, "--home", tmp_home, "--address", address, "--space", space)
    result = run_bilevel(*SMOKE, *options, "--workers-per-trial", "1")
    assert result.returncode == 1
    assert "no configuration finished a generation" in result.stdout
    assert "Traceback" not in result.stderr
