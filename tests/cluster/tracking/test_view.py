"""Views of all kinds of runs."""

from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.catalog import views_of
from cluster.storage.run_folder import BEST_FILE, RunIdentity, RunStatus
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


def test_a_missing_se_file_is_reported(folder: Path) -> None:
    (folder / BEST_FILE).unlink()
    with pytest.raises(InvalidInput, match=r"cannot read '.*best_se.safetensors': No such file"):
        views(folder)
