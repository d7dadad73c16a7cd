"""Views of all kinds of runs."""

import json
from pathlib import Path

import pytest

from cluster.catalog.kinds import views_of
from cluster.storage.run_folder import RunIdentity, RunStatus
from cluster.tracking import RunView
from tests.studies import make_study


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_study(tmp_path / "study")
    return tmp_path / "study"


def views(folder: Path) -> list[RunView]:
    """Views of the study and of its configurations."""
    source = views_of(folder)
    return [source.view(key) for key in source.keys()]  # noqa: SIM118


def test_notes_contain_the_command_and_whether_it_resumes_the_run(folder: Path) -> None:
    author = RunIdentity.read(folder).author
    assert author is not None
    assert all(f"`{author.command}`" in view.note for view in views(folder))
    assert "resume" not in views(folder)[0].note
    RunStatus("KILLED", 0.0, 4).save(folder)
    assert "run the same command again to resume." in views(folder)[0].note


@pytest.mark.parametrize("versions", [1, 2])
def test_changes_of_users_code_are_noted(versions: int, folder: Path) -> None:
    settings = json.loads((folder / "settings.json").read_text())
    settings["code"] = {"agent 'mine'": ["one", "two"][:versions]}
    (folder / "settings.json").write_text(json.dumps(settings))
    for view in views(folder):
        assert ("2 versions of the agent 'mine'" in view.note) == (versions == 2)
