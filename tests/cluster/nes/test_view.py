"""What MLflow is to show of an NES run."""

from pathlib import Path

import numpy as np
import pytest

from bilevel import InvalidInput
from bilevel.tasks import Task
from cluster.nes import selection
from cluster.nes.selection import FinalScore, export_best
from cluster.nes.view import registered
from cluster.storage.run_folder import finals
from tests.ses import make_se


def test_an_se_is_registered_with_its_own_scores(
    cartpole: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also by a run that is continued, and stopped where its end is half written."""

    def end(step: int, score: float) -> None:
        scores = FinalScore(np.array([score]), np.array([9]), 195.0)
        export_best(make_se(cartpole, seed=step), scores, tmp_path, step, 0, 0)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    end(5, 100.0)
    first = registered(tmp_path, cartpole.id, finals(tmp_path)[-1])
    assert first is not None
    assert first.tags["final_score_mean"] == "100"
    with monkeypatch.context() as context:
        context.setattr(selection, "add_final", killed)
        with pytest.raises(KeyboardInterrupt):
            end(9, 180.0)
    assert registered(tmp_path, cartpole.id, finals(tmp_path)[-1]) is None
    end(9, 180.0)
    second = registered(tmp_path, cartpole.id, finals(tmp_path)[-1])
    assert second is not None
    assert second.tags["final_score_mean"] == "180"
    assert second.version != first.version


def test_a_lost_se_is_told(cartpole: Task, tmp_path: Path) -> None:
    scores = FinalScore(np.array([100.0]), np.array([9]), 195.0)
    path, _ = export_best(make_se(cartpole), scores, tmp_path, 5, 0, 0)
    path.unlink()
    with pytest.raises(InvalidInput, match=r"best_se\.safetensors"):
        registered(tmp_path, cartpole.id, finals(tmp_path)[-1])
