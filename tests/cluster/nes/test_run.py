"""An NES run in its folder."""

from pathlib import Path

import pytest

from bilevel.errors import StorageFailure
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.nes.run import STATE_FILE, NESRun


def test_a_checkpoint_that_cannot_be_read_is_left_where_it_is(
    cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    """It may be sound: the disk is what fails."""
    run = NESRun(cartpole, small_hp, 0, tmp_path)
    run.open()
    state = tmp_path / STATE_FILE
    state.unlink()
    state.mkdir()  # reading it is an error of the disk
    for read in (run.open, run.load_if_sound):
        with pytest.raises(StorageFailure, match="cannot read checkpoint"):
            read()
    assert [path.name for path in tmp_path.iterdir()] == [STATE_FILE]
