"""The SE of a run in the model registry, and the way to it on the command line."""

from dataclasses import replace
from pathlib import Path

import click
import mlflow
import pytest

from bilevel import InvalidInput
from bilevel.synthetic_env import se_bytes
from bilevel.synthetic_env.source import se_file
from bilevel.tasks import Task
from cluster.cli.ses import SEAddress
from cluster.cli.show import show
from cluster.storage.home import Home
from cluster.storage.run_folder import Lifetime
from cluster.tracking import Tracker
from cluster.tracking.view import RegisteredSE, RunView
from tests.commands import run_bilevel
from tests.ses import make_se


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


def test_an_address_that_is_no_version_of_a_model(home: Home) -> None:
    """MLflow would look such addresses up elsewhere."""
    with pytest.raises(InvalidInput, match="allowed are models:/NAME@ALIAS and models:/NAME/VERS"):
        se_file("models:/SE-CartPole-v0/latest", home.database_uri)


def test_the_command_line_looks_in_its_home(home: Home, tmp_path: Path) -> None:
    """Not in a database of MLflow's in the current folder, and none is made there."""
    here = tmp_path / "here"
    here.mkdir()
    address = "models:/SE-CartPole-v0@best"
    shown = run_bilevel("show", address, "--home", home.folder, cwd=here)
    assert shown.returncode == 0, shown.stderr
    assert [path.name for path in here.iterdir()] == ["SE-CartPole-v0-1.png"]
    missing = run_bilevel("show", address, "--home", here / "other", cwd=here)
    assert missing.returncode == 2
    assert "MLflow has no SE at" in missing.stderr
    other = here / "other"
    other.mkdir()
    (other / "mlflow.db").write_bytes(b"no database at all, but some bytes" * 99)
    damaged = run_bilevel("show", address, "--home", other, cwd=here)
    assert damaged.returncode == 2
    assert damaged.stderr.count("\n") == 1
    assert "is damaged: file is not a database" in damaged.stderr
    absent = "http://127.0.0.1:9"
    missing = run_bilevel("show", address, "--tracking-uri", absent, cwd=here)
    assert missing.returncode == 2
    assert f"no MLflow server at '{absent}'" in missing.stderr


def test_an_se_has_the_same_label_whenever_it_is_loaded(home: Home, content: bytes) -> None:
    """An evaluation resumes only under the same labels."""
    client = mlflow.MlflowClient(home.database_uri)
    (version,) = client.search_model_versions("name = 'SE-CartPole-v0'")
    file = home.folder / "best_se.safetensors"
    file.write_bytes(content)
    client.log_artifact(version.run_id, str(file))
    convert, context = SEAddress().convert, click.Context(show, obj=None)
    context.params = {"home": home.folder, "tracking_uri": home.database_uri}
    for address, label in (
        ("models:/SE-CartPole-v0@best", "SE-CartPole-v0-1"),
        ("models:/SE-CartPole-v0/1", "SE-CartPole-v0-1"),
        (f"runs:/{version.run_id}/best_se.safetensors", version.run_id),
    ):
        found = convert(address, None, context)
        assert (found.label, found.path.read_bytes()) == (label, content)


def test_a_variant_of_the_task_is_newest_but_never_best(home: Home, cartpole: Task) -> None:
    """Its scores mean something else: it may last longer, and not be solved."""
    longer = make_se(replace(cartpole, step_limit=500, solved_reward=475.0))
    tracker = Tracker(home.database_uri, "CartPole-v0", home.artifacts)
    model = RegisteredSE(se_bytes(longer), "CartPole-v0", 6.0, {"final_score_mean": "240.0"})
    lifetime = Lifetime("FINISHED", 1.0, 2.0)
    tracker.show(RunView("other key", "longer", lifetime, {}, {}, model=model))
    client = mlflow.MlflowClient(home.database_uri)
    versions = [
        client.get_model_version_by_alias("SE-CartPole-v0", alias) for alias in ("best", "newest")
    ]
    assert [version.tags["final_score_mean"] for version in versions] == ["100.0", "240.0"]
    assert versions[1].tags["bilevel.task_variant"] == "500 steps, solved at 475"
