"""`bilevel nes` as a user runs it: real Ray, real MLflow, killed for real."""

import os
import signal
from dataclasses import asdict
from pathlib import Path

import gymnasium
import mlflow.pyfunc
import numpy as np
import pandas as pd
import pytest

import bilevel  # noqa: F401  (registers the environment)
from bilevel.nes import NESState
from tests.commands import run_bilevel
from tests.system.conftest import client, run_until

pytestmark = pytest.mark.timeout(280)

SMALL = (
    *("nes", "CartPole-v0", "--population", "2", "--start-candidates", "2", "--name", "run"),
    *("--set", "nes.start=random", "--set", "nes.momentum=0.7", "--set", "ddqn.max_episodes=13"),
)


def scores(home: Path) -> list[dict[str, float]]:
    """The run's records, less the measured times."""
    state = NESState.load(home / "CartPole-v0" / "run" / "state.safetensors")
    times = {"env_steps_per_second", "generation_seconds", "core_utilisation", "finished"}
    return [{k: v for k, v in asdict(r).items() if k not in times} for r in state.records]


def test_a_run_its_tracking_and_its_continuation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = run_bilevel(*SMALL, "--generations", "2", "--home", tmp_path)
    assert result.returncode == 0, result.stderr
    assert "generation   1   score" in result.stdout
    assert "10 fresh agents trained on the best SE score" in result.stdout
    longer = run_bilevel(*SMALL, "--generations", "3", "--workers", "1", "--home", tmp_path)
    assert longer.returncode == 0, longer.stderr
    assert "going on after generation 1" in longer.stdout
    assert "generation   0" not in longer.stdout

    refused = run_bilevel(*SMALL, "--update", "paper", "--home", tmp_path)
    assert refused.returncode == 2
    assert "'run' was begun with nes = " in refused.stderr
    assert refused.stderr.count("\n") == 1

    mlflow_client = client(tmp_path)
    experiment = mlflow_client.get_experiment_by_name("CartPole-v0")
    assert experiment is not None
    (tracked,) = mlflow_client.search_runs([experiment.experiment_id])
    assert tracked.info.status == "FINISHED"
    assert tracked.data.params["nes.population_size"] == "2"
    assert tracked.data.params["nes.momentum"] == "0.7"
    assert tracked.data.params["vary_agent"] == "small"
    assert tracked.data.params["agents.ddqn.batch_size"] == "128"
    for name, values in {
        key: [record[key] for record in scores(tmp_path)] for key in scores(tmp_path)[0]
    }.items():
        if name != "generation":
            history = mlflow_client.get_metric_history(tracked.info.run_id, name)
            assert [metric.step for metric in history] == [0, 1, 2], name
            assert [metric.value for metric in history] == values, name
    fitness = [record["fitness_mean"] for record in scores(tmp_path)]
    assert tracked.data.metrics["objective"] == pytest.approx(np.mean(fitness))
    shares = mlflow_client.get_metric_history(tracked.info.run_id, "core_utilisation")
    assert all(0 < metric.value < 1 for metric in shares)
    names = {file.path for file in mlflow_client.list_artifacts(tracked.info.run_id)}
    assert {"best_se.safetensors", "last_se.safetensors", "learning_curve.png"} <= names

    model = mlflow_client.get_model_version_by_alias("SE-CartPole-v0", "best")
    assert model.run_id == tracked.info.run_id
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/mlflow.db")
    loaded = mlflow.pyfunc.load_model("models:/SE-CartPole-v0@best")
    table = pd.DataFrame({f"state_{i}": np.zeros(2, np.float32) for i in range(4)})
    table["action"] = [0, 1]
    predicted = loaded.predict(table)
    assert list(predicted.columns) == [*(f"next_state_{i}" for i in range(4)), "reward", "done"]

    path = tmp_path / "CartPole-v0" / "run" / "best_se.safetensors"
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path=path)
    env.reset(seed=0)
    next_state, reward, *_ = env.step(np.int64(1))
    assert np.isfinite(next_state).all()
    assert np.isfinite(float(reward))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The home of a run that was never disturbed."""
    home = tmp_path_factory.mktemp("whole")
    assert run_bilevel(*SMALL, "--generations", "12", "--home", home).returncode == 0
    return home


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_killed_in_the_middle_it_goes_on(
    number: signal.Signals, whole: Path, tmp_path: Path
) -> None:
    """By one worker instead of two."""
    parts = tmp_path
    process = run_until("generation   1", *SMALL, "--generations", "12", "--home", parts)
    os.killpg(process.pid, number)  # to everyone, as a terminal does
    rest, _ = process.communicate(timeout=60)
    assert process.returncode == (130 if number is signal.SIGINT else -number), rest
    if number is signal.SIGINT:
        assert "the same command goes on from the last finished generation" in rest
    again = run_bilevel(*SMALL, "--generations", "12", "--workers", "1", "--home", parts)
    assert again.returncode == 0, again.stderr
    assert scores(parts) == scores(whole)
    files = [home / "CartPole-v0" / "run" / "best_se.safetensors" for home in (whole, parts)]
    states = [NESState.load(file.with_name("state.safetensors")) for file in files]
    np.testing.assert_array_equal(states[0].psi, states[1].psi)

    mlflow_client = client(parts)
    experiment = mlflow_client.get_experiment_by_name("CartPole-v0")
    assert experiment is not None
    (tracked,) = mlflow_client.search_runs([experiment.experiment_id])
    assert tracked.info.status == "FINISHED"
    history = mlflow_client.get_metric_history(tracked.info.run_id, "score_mean")
    assert [metric.step for metric in history] == list(range(12))


def test_it_stops_early_once_solved_and_confirmed(tmp_path: Path) -> None:
    easy = ("--solved-reward", "5", "--solved-for", "2", "--generations", "9")
    result = run_bilevel(*SMALL, *easy, "--home", tmp_path)
    assert result.returncode == 0, result.stderr
    assert "with 32 others: solved" in result.stdout
    assert "solved and stayed solved: 2 generations" in result.stdout
    assert "10 of 10 agents do" in result.stdout
