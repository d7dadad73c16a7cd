"""Histograms of transitions, and diverged agents."""

from pathlib import Path

import numpy as np
import pytest

from bilevel.errors import InvalidInput
from cluster.experiments.figures import behaviour
from cluster.experiments.figures.behaviour import ORIGINS, densities
from tests.cluster.experiments.artificial import findings_of


def test_diverged_agents_have_no_tests_to_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(behaviour, "record", lambda *arguments: ([], []))
    with pytest.raises(InvalidInput, match="all agents diverged on the SE"):
        findings_of(behaviour.BEHAVIOUR, tmp_path)


def test_values_of_the_tests_are_those_of_the_task(tmp_path: Path) -> None:
    """CartPole rewards every step with 1."""
    found = findings_of(behaviour.BEHAVIOUR, tmp_path)
    rows = {row["seen"]: row for row in found.summary}
    assert set(rows) == set(ORIGINS)
    tests = rows[behaviour.TESTS]
    assert (tests["reward"], tests["reward_std"]) == (1.0, 0.0)
    assert tests["steps"] == found.metrics["test_return"] * float(tests["evaluations"] or 0)


def test_histograms_contain_nearly_all_values() -> None:
    rng = np.random.default_rng(0)
    seen = {origin: rng.standard_normal((1000, 3)).astype(np.float32) for origin in ORIGINS}
    seen[ORIGINS[1]][:, 2] = 1.0  # constant, as CartPole's reward
    for _, bins in densities(seen, ["a", "b", "reward"]).groupby("value"):
        for origin in ORIGINS:
            assert 0.98 < bins[origin].sum() <= 1.0 + 1e-9
