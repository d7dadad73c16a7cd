"""The numbers of transfer."""

from pathlib import Path

import numpy as np
import pytest

from bilevel.tasks import Task
from cluster.evaluate.report import Group
from cluster.experiments.figures.transfer import TRANSFER, violins
from cluster.experiments.sizes import get_size
from cluster.experiments.style import styled
from tests.cluster.experiments.made_up import findings_of, group_results


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


def test_pictures_of_all_agents_share_their_axis(cartpole: Task) -> None:
    """From the lowest return of any agent on, so that they can be compared; each shows the return
    that solves the task."""
    for scores in ([200.0, 199.0], [150.0, 140.0]):
        group = Group("real", "ddqn", 195.0, group_results(cartpole, scores))
        with styled():
            figure = violins([group], "ddqn", cartpole, lowest=9.0)
        low, high = figure.axes[0].get_ylim()
        assert -10 < low < 9
        assert 195 < high < 215
