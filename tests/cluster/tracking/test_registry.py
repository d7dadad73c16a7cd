"""The SE of a run in the model registry, and the way to it on the command line."""

from pathlib import Path

import pytest

from bilevel import InvalidInput
from bilevel.gym.source import se_file
from cluster.storage.home import Home
from cluster.storage.run_folder import Lifetime
from cluster.tracking import Tracker
from cluster.tracking.view import RegisteredSE, RunView
from tests.commands import run_bilevel


@pytest.fixture
def home(tmp_path: Path, content: bytes) -> Home:
    """A home whose MLflow has an SE."""
    home = Home(tmp_path / "home")
    home.prepare()
    tracker = Tracker(home.database_uri, "CartPole-v0", home.artifacts)
    model = RegisteredSE(content, "CartPole-v0", 5.0, {"final_score_mean": "100.0"})
    lifetime = Lifetime("FINISHED", 1.0, 2.0)
    tracker.show(RunView("key", "a run", lifetime, {}, {}, model=model))
    return home


@pytest.fixture
def content(se_file: Path) -> bytes:
    return se_file.read_bytes()


@pytest.mark.parametrize("which", ["@newest", "@best", "/1"])
def test_a_registered_se_is_found_in_the_mlflow_that_is_given(
    which: str, home: Home, content: bytes
) -> None:
    found = se_file(f"models:/SE-CartPole-v0{which}", home.database_uri)
    assert found.read_bytes() == content


@pytest.mark.parametrize("address", ["models:/SE-CartPole-v0@worst", "models:/none/1"])
def test_one_that_is_not_there(address: str, home: Home) -> None:
    with pytest.raises(InvalidInput, match="MLflow has no SE at"):
        se_file(address, home.database_uri)


def test_the_command_line_looks_in_its_home(home: Home, tmp_path: Path) -> None:
    """Not in a database of MLflow's in the current folder, and none is made there."""
    here = tmp_path / "here"
    here.mkdir()
    address = "models:/SE-CartPole-v0@best"
    shown = run_bilevel("show", address, "--home", home.folder, "--out", "se.svg", cwd=here)
    assert shown.returncode == 0, shown.stderr
    assert [path.name for path in here.iterdir()] == ["se.svg"]
    missing = run_bilevel("show", address, "--home", here / "other", cwd=here)
    assert missing.returncode == 2
    assert "MLflow has no SE at" in missing.stderr
