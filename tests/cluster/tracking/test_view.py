"""What MLflow is to show."""

import json
from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.bohb.study.definition import configuration_name
from cluster.bohb.study.journal import Journal
from cluster.catalog.kinds import views_of
from cluster.storage.run_folder import BEST_FILE, Final, RunIdentity, RunStatus
from cluster.tracking.view import Point
from tests.studies import make_study


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_study(tmp_path / "study")
    return tmp_path / "study"


def test_every_run_tells_who_began_it_and_how(folder: Path) -> None:
    views, identity = views_of(folder), RunIdentity.read(folder)
    assert identity.author is not None
    assert identity.author.command
    assert [views.view(key).identity for key in views.keys()] == [identity] * len(views.keys())  # noqa: SIM118


def test_a_configuration_is_named_by_what_differs_and_shows_what_is_tuned(folder: Path) -> None:
    views = views_of(folder)
    _, *children = (views.view(key) for key in views.keys())  # noqa: SIM118
    tried = Journal(folder).configs
    assert [child.name for child in children] == [configuration_name(line.id) for line in tried]
    assert [child.params for child in children] == [line.configuration for line in tried]


def test_a_stopped_study_says_that_it_can_go_on(folder: Path) -> None:
    views = views_of(folder)
    key = next(iter(views.keys()))
    assert "resumes" not in views.view(key).note
    assert "Begun by `" in views.view(key).note
    RunStatus("KILLED", 0.0, 4).save(folder)
    note = views.view(key).note
    assert note.startswith("**Stopped, and nothing is lost:** ")
    assert "the same command resumes it." in note


def test_a_run_says_that_users_code_has_changed(folder: Path) -> None:
    settings = json.loads((folder / "settings.json").read_text())
    for versions, told in ((["one"], False), (["one", "two"], True)):
        settings["code"] = {"agent 'mine'": versions}
        (folder / "settings.json").write_text(json.dumps(settings))
        views = views_of(folder)
        study, *configurations = [views.view(key).note for key in views.keys()]  # noqa: SIM118
        assert ("Begun and resumed with 2 versions of the agent 'mine'" in study) == told
        assert configurations
        assert not any("versions" in note for note in configurations)  # which ran, nobody knows


def test_a_deleted_se_file_is_an_error_of_the_disk(folder: Path) -> None:
    (folder / BEST_FILE).unlink()
    views = views_of(folder)
    with pytest.raises(InvalidInput, match=r"cannot read '.*best_se.safetensors': No such file"):
        views.view(next(iter(views.keys())))


def test_final_scores_may_follow_at_the_same_step() -> None:
    """A new best SE without a new result; generations are written once."""
    first, later = (Point.of_final(Final(8, time, {"score": 2.0})) for time in (1.0, 2.0))
    assert first.mark != later.mark
    assert Point({"score": 1.0}, 8, 1.0).mark == Point({"score": 1.0}, 8, 2.0).mark
