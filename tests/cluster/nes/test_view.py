"""MLflow view of an NES run."""

from collections.abc import Callable
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


@pytest.fixture
def end(cartpole: Task, tmp_path: Path) -> Callable[[int, float], Path]:
    """Write the best SE and its score, as at the end of a run."""

    def write(step: int, score: float) -> Path:
        scores = FinalScore(np.array([score]), np.array([9]), 195.0)
        return export_best(make_se(cartpole, seed=step), scores, tmp_path, step, 0, 0)[0]

    return write


def test_an_se_is_registered_with_its_own_scores(
    end: Callable[[int, float], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if a continued run is killed between the writes of the SE and of its scores."""

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    end(5, 100.0)
    first = registered(tmp_path, "CartPole-v0", finals(tmp_path)[-1])
    assert first is not None
    assert first.tags["final_score_mean"] == "100"
    with monkeypatch.context() as context:
        context.setattr(selection, "add_final", killed)
        with pytest.raises(KeyboardInterrupt):
            end(9, 180.0)
    assert registered(tmp_path, "CartPole-v0", finals(tmp_path)[-1]) is None
    end(9, 180.0)
    second = registered(tmp_path, "CartPole-v0", finals(tmp_path)[-1])
    assert second is not None
    assert second.tags["final_score_mean"] == "180"
    assert second.version != first.version


def test_a_missing_se_file_is_reported(end: Callable[[int, float], Path], tmp_path: Path) -> None:
    end(5, 100.0).unlink()
    with pytest.raises(InvalidInput, match=r"best_se\.safetensors"):
        registered(tmp_path, "CartPole-v0", finals(tmp_path)[-1])
