"""An NES run in its folder."""

from pathlib import Path

import numpy as np
import pytest

from bilevel.errors import StorageFailure
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NESState
from bilevel.tasks import Task
from cluster.nes.run import STATE_FILE, NESRun
from cluster.nes.view import NESViews
from cluster.storage.run_folder import RunStatus, locked_settings
from tests.studies import MadeUpPool


@pytest.fixture
def run(cartpole: Task, small_hp: Hyperparameters, tmp_path: Path) -> NESRun:
    return NESRun(cartpole, small_hp, 5, tmp_path)


def advanced(run: NESRun, log: list[str]) -> NESState:
    """The state after two generations."""
    state = run.open(log.append)
    while state.generation < 2:
        state = run.advance(state, MadeUpPool())
    return state


def test_a_damaged_checkpoint_is_renamed_and_computed_again(run: NESRun) -> None:
    log: list[str] = []
    before = advanced(run, log)
    content = bytearray(run.state_file.read_bytes())
    content[-3] ^= 4
    run.state_file.write_bytes(content)
    assert run.load_if_sound() is None
    after = advanced(run, log)
    (line,) = log
    assert "its checksum is wrong; renamed to 'state.damaged'" in line
    assert run.state_file.with_suffix(".damaged").read_bytes() == content
    np.testing.assert_array_equal(after.search.mean, before.search.mean)


def test_an_unreadable_checkpoint_is_not_renamed(run: NESRun) -> None:
    """It may be intact: the disk has failed."""
    run.state_file.mkdir(parents=True)  # reading a folder is a disk error
    for read in (run.open, run.load_if_sound):
        with pytest.raises(StorageFailure, match="cannot read checkpoint"):
            read()
    assert [path.name for path in run.folder.iterdir()] == [STATE_FILE]


def test_progress_never_exceeds_the_total(run: NESRun) -> None:
    """A later call may ask for fewer generations than exist."""
    with locked_settings(run.folder, run.settings()):
        pass

    def progress(target: int) -> str:
        RunStatus("KILLED", 0.0, target).save(run.folder)
        return NESViews(run.folder).progress()[0]

    assert progress(3) == "0/3 generations"
    advanced(run, [])
    done = [progress(generations) for generations in (1, 2, 9)]
    assert done == ["2/2 generations", "2/2 generations", "2/9 generations"]
