"""`bilevel nes` as a user runs it: real Ray, MLflow and kills."""

import os
import re
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bilevel import load  # (registers the environment)
from bilevel.nes import NESState
from bilevel.tasks.task import SCALE_STEPS
from cluster.nes.run import NESRun
from tests.commands import BILEVEL, run_bilevel
from tests.mlflow_shown import disagreements
from tests.system.conftest import client, run_until, untimed

pytestmark = pytest.mark.timeout(280)

SMALL = (
    *("nes", "CartPole-v0", "--population", "2", "--name", "run"),
    *("--set", "nes.start_candidates=2", "--set", "nes.centre_agents=2"),
    *("--set", "nes.patient_episodes=15", "--set", "ddqn.init_episodes=5"),
    *("--set", "ddqn.max_episodes=13"),  # short, because the last agents have all sizes
)


#: One actor, because each takes two core seconds to start.
ALONE = ("--workers", "1")

#: Enough generations of milliseconds that a signal arrives before the last one.
MANY = 30


def state_of(home: Path) -> NESState:
    """Return the state in the run's checkpoint."""
    state = NESRun.read(home / "CartPole-v0" / "run").load()
    assert state is not None
    return state


def scores(home: Path) -> list[dict[str, float]]:
    """Return the run's records without the measured times."""
    return untimed(state_of(home))


def test_a_run_in_mlflow_and_after_a_resume(
    tmp_home: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = run_bilevel(*SMALL, "--generations", "2", "--home", tmp_home)
    assert result.returncode == 0, result.stderr
    assert "generation   1  score" in result.stdout
    assert "10 fresh agents trained on the best SE score" in result.stdout
    joined = (*SMALL, "--home", tmp_home, "--address", address)
    longer = run_bilevel(*joined, "--generations", "3", *ALONE)
    assert longer.returncode == 0, longer.stderr
    assert "resuming after generation 1" in longer.stdout
    assert "generation   0" not in longer.stdout

    refused = run_bilevel(*joined, "--set", "nes.update=paper")
    assert refused.returncode == 2
    assert "'run' was started with nes." in refused.stderr
    assert refused.stderr.count("\n") == 1

    assert disagreements(tmp_home / "CartPole-v0" / "run", f"sqlite:///{tmp_home}/mlflow.db") == []
    mlflow_client = client(tmp_home)
    (experiment,) = mlflow_client.search_experiments()
    assert experiment.name == "CartPole-v0"
    (tracked,) = mlflow_client.search_runs([experiment.experiment_id])
    page = f"experiments/{experiment.experiment_id}/runs/{tracked.info.run_id}?workflowType="
    assert page in result.stdout
    assert f"ui --home {tmp_home}`" in result.stdout
    tags, params = tracked.data.tags, tracked.data.params
    assert tags["mlflow.source.name"].startswith("bilevel nes CartPole-v0")
    assert "--set nes.centre_agents=2" in tags["mlflow.note.content"]
    assert tags["mlflow.user"]
    assert (tags["bilevel.kind"], tags["bilevel.generations"]) == ("nes", "3")
    assert "nes.generations" not in params  # parameters cannot change
    assert params["nes.population_size"] == "2"
    assert params["agents.ddqn.batch_size"] == "64"
    records = scores(tmp_home)
    costs = [record["cost"] for record in records]
    assert 0 < costs[0] < costs[1] < costs[2]
    steps = [record["real_env_steps"] for record in records]
    assert SCALE_STEPS < steps[0] < steps[1] < steps[2]
    for output, last in ((result.stdout, steps[1]), (longer.stdout, steps[2])):
        found = re.search(r"(\d+) steps on the real task", output)
        assert found is not None
        assert int(found[1]) >= last
    names = {file.path for file in mlflow_client.list_artifacts(tracked.info.run_id)}
    assert {"best_se.safetensors", "last_se.safetensors", "learning_curve.png"} <= names

    path = tmp_home / "CartPole-v0" / "run" / "best_se.safetensors"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_home}/mlflow.db")
    registered = load("models:/SE-CartPole-v0@best")
    np.testing.assert_array_equal(registered.psi, load(path).psi)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, address: str) -> Path:
    """Return the home of an uninterrupted run."""
    home = tmp_path_factory.mktemp("whole")
    result = run_bilevel(*SMALL, "--generations", str(MANY), "--home", home, "--address", address)
    assert result.returncode == 0, result.stderr
    return home


def test_a_stopped_and_killed_run_resumes(whole: Path, tmp_home: Path, address: str) -> None:
    """With another number of workers, and with the same scores as an uninterrupted run."""
    parts = tmp_home
    command = (*SMALL, "--generations", str(MANY), "--home", parts, "--address", address)
    stopped = run_until("generation   1", *command)
    os.killpg(stopped.pid, signal.SIGINT)  # to all processes, as a terminal does
    rest, _ = stopped.communicate(timeout=60)
    assert stopped.returncode == 130, rest
    assert "run the same command again to resume after the last finished generation" in rest
    killed = run_until("train steps", *command)  # after its first generation
    os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate(timeout=60)
    assert killed.returncode == -signal.SIGKILL
    again = run_bilevel(*command, *ALONE)
    assert again.returncode == 0, again.stderr
    assert scores(parts) == scores(whole)
    np.testing.assert_array_equal(state_of(whole).search.mean, state_of(parts).search.mean)

    assert disagreements(parts / "CartPole-v0" / "run", f"sqlite:///{parts}/mlflow.db") == []


def test_a_signal_to_the_process_group_stops_the_run_in_order(tmp_home: Path) -> None:
    """`timeout` and batch systems send SIGTERM to the group, which includes Ray's processes."""
    process = run_until("generation   0", *SMALL, "--generations", "900", "--home", tmp_home)
    os.killpg(process.pid, signal.SIGTERM)
    rest, _ = process.communicate(timeout=120)
    assert process.returncode == 130, rest
    assert "interrupted; run the same command again to resume" in rest
    assert "GCS" not in rest


EASY = (
    *("--solved-reward", "5", "--solved-for", "2", "--generations", "9"),
    *("--set", "nes.confirming_agents=4"),
)


def test_it_stops_early_once_solved_and_confirmed(tmp_home: Path, address: str) -> None:
    result = run_bilevel(*SMALL, *EASY, *ALONE, "--home", tmp_home, "--address", address)
    assert result.returncode == 0, result.stderr
    assert "fresh agents trained on the current SE: confirmed" in result.stdout
    assert "solved and confirmed: 2 generations" in result.stdout
    assert "10 of 10 agents reach 5" in result.stdout


def test_a_stagnating_run_restarts(tmp_home: Path, address: str) -> None:
    """If no agent solves the task, one generation without a new best SE causes a restart."""
    hard = ("--solved-reward", "999", "--set", "nes.restart_after=1", "--generations", "6")
    result = run_bilevel(*SMALL, *hard, *ALONE, "--home", tmp_home, "--address", address)
    assert result.returncode == 0, result.stderr
    attempts = [int(record["attempt"]) for record in scores(tmp_home)]
    assert attempts == sorted(attempts)
    assert attempts[-1] >= 1
    restarts = result.stdout.count("no new best SE for 1 generations: attempt")
    assert restarts >= attempts[-1]
    assert result.stdout.count("choosing a start among 2 random SEs") == restarts + 1


def test_a_custom_task_on_a_joined_cluster(tmp_home: Path, address: str) -> None:
    """The cluster's nodes find its module through PYTHONPATH."""
    code, elsewhere = tmp_home / "code", tmp_home / "elsewhere"
    code.mkdir()
    elsewhere.mkdir()
    (code / "mine.py").write_text(
        """
import gymnasium
from gymnasium.envs.classic_control import CartPoleEnv

gymnasium.register("Mine-v0", CartPoleEnv, max_episode_steps=9, reward_threshold=8)
"""
    )
    small = ("mine:Mine-v0", *SMALL[2:], *ALONE, "--set", "ddqn.test_episodes=2")
    result = subprocess.run(
        [BILEVEL, "nes", *small, "--generations", "1", "--home", tmp_home, "--address", address],
        capture_output=True,
        text=True,
        cwd=elsewhere,
        env={**os.environ, "PYTHONPATH": "../code"},
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert "generation   0  score" in result.stdout


def test_the_default_name_contains_recipe_and_agents(tmp_home: Path, address: str) -> None:
    small = [word for word in SMALL if word not in ("--name", "run")]
    chosen = ("--recipe", "paper", "--agent", "td3", "--vary-hp", "small")
    few = ("--generations", "1", "--seed", "3")
    ended = ("--solved-for", "1", *ALONE, "--set", "se.step_limit=20")
    words = [word.replace("ddqn", "td3") for word in small]
    result = run_bilevel(*words, *chosen, *few, *ended, "--home", tmp_home, "--address", address)
    assert result.returncode == 0, result.stderr
    run = NESRun.read(tmp_home / "CartPole-v0" / "nes-paper-td3-small-seed3")
    assert (run.hp.nes.update, run.hp.se.family) == ("paper", "plain")
    # The recipe never stops early. Asking for it turns confirmation on, too.
    assert (run.hp.nes.solved_for, run.hp.nes.confirming_agents) == (1, 128)
    assert run.load() is not None
