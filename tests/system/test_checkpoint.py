"""A damaged checkpoint, on a real pool."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.nes.run import STATE_FILE, NESRun
from cluster.ray.pool import EvaluationPool
from tests.system.conftest import untimed

pytestmark = pytest.mark.timeout(280)


def reach(generations: int, run: NESRun, pool: EvaluationPool, log: Callable[[str], None]) -> None:
    state = run.open(log)
    while state.generation < generations:
        state = run.advance(state, pool)


def test_a_damaged_checkpoint_is_renamed_and_computed_again(
    joined_ray: None, cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    run = NESRun(cartpole, small_hp, 5, tmp_path / "run")
    logged: list[str] = []
    with EvaluationPool(1) as pool:
        reach(2, run, pool, logged.append)
        path = run.folder / STATE_FILE
        before = run.load()
        content = bytearray(path.read_bytes())
        content[-3] ^= 4
        path.write_bytes(content)
        reach(2, run, pool, logged.append)
    assert len(logged) == 1
    assert "its checksum is wrong; renamed to 'state.damaged'" in logged[0]
    assert path.with_suffix(".damaged").read_bytes() == content
    after = run.load()
    assert before is not None
    assert after is not None
    assert untimed(after) == untimed(before)
    np.testing.assert_array_equal(after.search.mean, before.search.mean)
    for finalist, expected in zip(after.finalists, before.finalists, strict=True):
        np.testing.assert_array_equal(finalist.genotype, expected.genotype)
