"""MLflow view of an NES run."""

from pathlib import Path

import numpy as np
import pytest

from bilevel import InvalidInput
from bilevel.tasks import Task
from cluster.nes.selection import FinalScore, export_best
from cluster.nes.view import registered
from cluster.storage.run_folder import Final, finals
from tests.ses import make_se


def test_an_se_is_registered_with_its_own_scores(cartpole: Task, tmp_path: Path) -> None:
    """Also if a continued run is killed between the writes of the SE and of its scores."""
    ends, versions = list[Final](), set[str]()
    for step, score in ((5, 100.0), (9, 180.0)):
        scores = FinalScore(np.array([score]), np.array([9]), 195.0)
        path, _ = export_best(make_se(cartpole, seed=step), scores, tmp_path, step, 0, 0)
        ends = ends or finals(tmp_path)
        se = registered(tmp_path, "CartPole-v0", ends[-1])
        assert se.tags["final_score_mean"] == f"{score:g}"
        versions.add(se.file.version)
    assert len(versions) == 2
    path.unlink()
    with pytest.raises(InvalidInput, match=r"cannot read '.*best_se\.safetensors'"):
        registered(tmp_path, "CartPole-v0", ends[-1])
