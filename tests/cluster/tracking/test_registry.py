"""The SEs of runs in MLflow's model registry, and their addresses on the command line."""

from dataclasses import replace
from pathlib import Path

import mlflow
import mlflow.pyfunc
import numpy as np
import pandas as pd
import pytest
from mlflow.exceptions import MlflowException

from bilevel import InvalidInput
from bilevel.synthetic_env import load_se, save_se
from bilevel.synthetic_env.source import se_file
from cluster.cli.ses import given_se
from cluster.storage.home import Home
from cluster.storage.run_folder import Lifetime
from cluster.tracking import Document, RegisteredSE, RunView, Tracker
from tests.commands import run_bilevel

BEST = "models:/SE-CartPole-v0@best"


@pytest.fixture
def content(se_file: Path) -> bytes:
    return se_file.read_bytes()


@pytest.fixture
def home(tmp_path: Path, content: bytes) -> Home:
    """A home whose MLflow has an SE."""
    home = Home(tmp_path / "home")
    home.prepare()
    register(home, content, 5.0, "100.0")
    return home


def register(home: Home, content: bytes, time: float, score: str) -> None:
    """Show a run with that SE."""
    file = Document.of("best_se.safetensors", content)
    model = RegisteredSE(file, "CartPole-v0", time, {"final_score_mean": score})
    tracker = Tracker(home.database_uri, "CartPole-v0", home)
    tracker.show(RunView(score, score, Lifetime("FINISHED", 1.0, 2.0), {}, {}, model=model))


@pytest.mark.parametrize("which", ["@newest", "@best", "/1"])
def test_a_registered_se_is_found(which: str, home: Home, content: bytes) -> None:
    found = se_file(f"models:/SE-CartPole-v0{which}", home.database_uri)
    assert found.read_bytes() == content


def test_mlflow_loads_a_registered_se_as_a_model(
    home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", home.database_uri)
    model = mlflow.pyfunc.load_model(BEST)
    table = pd.DataFrame({f"state_{i}": np.zeros(2, np.float32) for i in range(4)})
    table["action"] = [0, 1]
    predicted = model.predict(table)
    assert list(predicted.columns) == [*(f"next_state_{i}" for i in range(4)), "reward", "done"]
    with pytest.raises(MlflowException, match=r"missing inputs \['action'\]"):
        model.predict(table.drop(columns="action"))
    with pytest.raises(InvalidInput, match="action 2 is not allowed"):
        model.predict(table.assign(action=2))


def test_the_best_se_is_one_of_the_unchanged_task(home: Home, se_file: Path) -> None:
    client = mlflow.MlflowClient(home.database_uri)
    variant = home.folder / "variant.safetensors"
    save_se(replace(load_se(se_file), step_limit=50), variant)
    register(home, variant.read_bytes(), 6.0, "200.0")
    versions = {
        alias: int(client.get_model_version_by_alias("SE-CartPole-v0", alias).version)
        for alias in ("best", "newest")
    }
    assert versions == {"best": 1, "newest": 2}


@pytest.mark.parametrize("address", ["models:/SE-CartPole-v0@worst", "models:/none/1"])
def test_unknown_addresses_are_rejected(address: str, home: Home) -> None:
    with pytest.raises(InvalidInput, match="MLflow has no SE at"):
        se_file(address, home.database_uri)


def test_the_command_line_searches_only_its_home(home: Home, tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    shown = run_bilevel("show", BEST, "--home", home.folder, cwd=here)
    assert shown.returncode == 0, shown.stderr
    assert [path.name for path in here.iterdir()] == ["SE-CartPole-v0-1.png"]
    missing = run_bilevel("show", BEST, "--home", here / "other", cwd=here)
    assert missing.returncode == 2
    assert "MLflow has no SE at" in missing.stderr


def test_the_label_of_an_se_does_not_change(home: Home, content: bytes) -> None:
    """Evaluations resume only with the same labels."""
    client = mlflow.MlflowClient(home.database_uri)
    (version,) = client.search_model_versions("name = 'SE-CartPole-v0'")
    file = home.folder / "best_se.safetensors"
    file.write_bytes(content)
    client.log_artifact(version.run_id, str(file))
    for address, label in (
        (BEST, "SE-CartPole-v0-1"),
        ("models:/SE-CartPole-v0/1", "SE-CartPole-v0-1"),
        (f"runs:/{version.run_id}/best_se.safetensors", version.run_id),
    ):
        path, found = given_se(address, home.folder, None)
        assert (found, path.read_bytes()) == (label, content)
