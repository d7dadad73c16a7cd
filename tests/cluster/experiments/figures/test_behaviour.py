"""What agents meet: recorded transitions, and their histograms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bilevel.errors import InvalidInput
from bilevel.evaluation import record
from bilevel.evaluation.recording import Recording
from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.tasks import get_task
from cluster.experiments.figures import behaviour
from cluster.experiments.figures.behaviour import ORIGINS, _loaded, _npz, columns, histograms
from cluster.experiments.style import styled
from cluster.experiments.table import Row
from tests.cluster.experiments.made_up import findings_of
from tests.ses import make_se


@pytest.fixture
def short_agent(small_agent: DDQNHyperparameters) -> DDQNHyperparameters:
    return replace(small_agent, init_episodes=3, max_episodes=5)


@pytest.mark.parametrize("kept", [0, 1, 2])
def test_a_recording_that_was_cut_off_is_told(kept: int, tmp_path: Path) -> None:
    """Cut to so many thirds."""
    path, whole = tmp_path / "agent.npz", _npz({"states": np.ones((50, 4), np.float32)})
    path.write_bytes(whole[: kept * len(whole) // 3])
    with pytest.raises(InvalidInput, match=r"damaged file '.*agent.npz'.*; delete it"):
        _loaded(path)


def test_a_recording_with_any_byte_changed_is_read_or_told(tmp_path: Path) -> None:
    path, whole = tmp_path / "agent.npz", _npz({"states": np.ones((50, 4), np.float32)})
    told = 0
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 5]) + whole[place + 1 :])
        try:
            _loaded(path)
        except InvalidInput:
            told += 1
    assert told > len(whole) / 4


def test_transitions_as_arrays(short_agent: DDQNHyperparameters) -> None:
    task = replace(get_task("CartPole-v0"), step_limit=20)
    training = record(task, make_se(task).se, short_agent, 5).training
    arrays = columns("train", training, task.state_size)
    assert {name: array.shape[1:] for name, array in arrays.items()} == {
        "train_states": (4,),
        "train_actions": (),
        "train_rewards": (),
        "train_next": (4,),
    }
    # States are kept as they were, not as the environment's memory is now.
    np.testing.assert_array_equal(arrays["train_states"][1], arrays["train_next"][0])
    assert len(np.unique(arrays["train_states"], axis=0)) > 10


def test_an_agent_that_diverges_has_no_tests(short_agent: DDQNHyperparameters) -> None:
    task = get_task("CartPole-v0")
    se = make_se(task).se
    broken = replace(se, psi=np.full_like(se.psi, np.nan))
    made = record(task, broken, short_agent, 5)
    assert made.tests == []
    for transitions in (made.training, made.tests):
        arrays = columns("test", transitions, task.state_size)
        assert [array.shape for array in arrays.values()] == [(0, 4), (0,), (0,), (0, 4)]


def test_if_all_agents_have_diverged_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(behaviour, "record", lambda *given: Recording())
    with pytest.raises(InvalidInput, match="all 2 agents have diverged on the SE with seed 0"):
        findings_of(behaviour.BEHAVIOUR, tmp_path)


def test_histograms_hold_nearly_all_values() -> None:
    rng = np.random.default_rng(0)
    seen = {origin: rng.standard_normal((1000, 3)).astype(np.float32) for origin in ORIGINS}
    seen[ORIGINS[1]][:, 2] = 1.0  # as CartPole's reward is
    rows: list[Row] = []
    with styled():
        figure = histograms(seen, ["a", "b", "reward"], "CartPole-v0", rows)
    assert [axes.get_xlabel() for axes in figure.axes[:3]] == ["a", "b", "reward"]
    for name in ("a", "b", "reward"):
        for origin in ORIGINS:
            shares = [row[origin] for row in rows if row["value"] == name]
            assert 0.98 < sum(float(share or 0) for share in shares) <= 1.0 + 1e-9
