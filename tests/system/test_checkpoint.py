"""A checkpoint that was damaged on disk, on a real pool."""

from pathlib import Path

import pytest

from benchmarks.faults.outcome import comparable_state
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.nes_loop import STATE_FILE, NESRun
from cluster.pool import EvaluationPool

pytestmark = pytest.mark.timeout(280)


def test_a_damaged_checkpoint_is_set_aside_and_made_again(
    local_ray: None, cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    run = NESRun(cartpole, small_hp, 5, tmp_path / "run")
    told: list[str] = []
    with EvaluationPool(1) as pool:
        run.reach(2, pool, told.append)
        path = run.folder / STATE_FILE
        before = comparable_state(path)
        content = bytearray(path.read_bytes())
        content[-3] ^= 4
        path.write_bytes(content)
        run.reach(2, pool, told.append)
    assert len(told) == 1
    assert "its checksum is wrong; it is now 'state.damaged'" in told[0]
    assert path.with_suffix(".damaged").read_bytes() == content
    assert comparable_state(path) == before
