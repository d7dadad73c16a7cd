"""An NES run in its folder."""

from pathlib import Path

import pytest

from bilevel.errors import StorageFailure
from bilevel.evaluation import evaluate
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.nes.run import STATE_FILE, NESRun
from cluster.nes.view import nes_progress
from cluster.storage.run_folder import locked_settings


def test_an_unreadable_checkpoint_is_not_renamed(
    cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    """It may be intact: the disk has failed."""
    run = NESRun(cartpole, small_hp, 0, tmp_path)
    run.open()
    state = tmp_path / STATE_FILE
    state.unlink()
    state.mkdir()  # reading a folder is a disk error
    for read in (run.open, run.load_if_sound):
        with pytest.raises(StorageFailure, match="cannot read checkpoint"):
            read()
    assert [path.name for path in tmp_path.iterdir()] == [STATE_FILE]


def test_progress_never_exceeds_the_total(
    cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    """A later call may ask for fewer generations than exist."""
    run = NESRun(cartpole, small_hp, 0, tmp_path)
    with locked_settings(tmp_path, run.settings()):
        assert nes_progress(tmp_path, 3).done == "0/3 generations"
        state = run.nes.run(lambda ses, requests: [evaluate(cartpole, ses, r) for r in requests])
        run.nes.save(state, tmp_path / STATE_FILE)
    done = [nes_progress(tmp_path, generations).done for generations in (1, 2, 9)]
    assert done == ["2/2 generations", "2/2 generations", "2/9 generations"]
