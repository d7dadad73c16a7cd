"""The numbers of transfer."""

from pathlib import Path

import numpy as np
import pytest

from cluster.experiments.figures.transfer import TRANSFER
from cluster.experiments.sizes import get_size
from tests.cluster.experiments.made_up import findings_of


def test_each_source_has_its_agents(tmp_path: Path) -> None:
    findings, size = findings_of(TRANSFER, tmp_path), get_size("smoke")
    for row in findings.summary:
        on_real = row["source"] == "real"
        assert row["agents"] == (size.real_agents if on_real else size.ses * size.agents)
        scores = [
            float(one["score"] or 0)
            for one in findings.data
            if (one["agent"], one["source"]) == (row["agent"], row["source"])
        ]
        assert row["test_return"] == pytest.approx(np.mean(scores))
        assert row["standard_error_over_ses"] is None  # of one SE


def test_pictures_of_all_agents_share_their_axis(tmp_path: Path) -> None:
    """So that they can be compared, and each shows the return that solves the task."""
    figures = findings_of(TRANSFER, tmp_path).figures
    ends = [figure.axes[0].get_ylim() for figure in figures.values()]
    assert len(ends) == 3
    assert len({low for low, _ in ends}) == 1
    assert all(low < 195 < high for low, high in ends)
