"""Statistics and violins of test returns."""

from pathlib import Path

import pytest

from bilevel.tasks import Task
from cluster.evaluate.report import Group
from cluster.experiments.figures.transfer import TRANSFER, violins
from cluster.experiments.sizes import get_size
from cluster.experiments.style import styled
from tests.cluster.experiments.artificial import findings_of
from tests.results import made_up_result


def test_summary_covers_the_agents_of_each_source(tmp_path: Path) -> None:
    findings, size = findings_of(TRANSFER, tmp_path), get_size("smoke")
    groups = findings.data.groupby(["agent", "source"])
    for row in findings.summary:
        on_real = row["source"] == "real"
        assert row["agents"] == (size.real_agents if on_real else size.ses * size.agents)
        scores = groups.get_group((row["agent"], row["source"]))["score"]
        assert row["test_return"] == pytest.approx(scores.mean())
        assert row["standard_error_over_ses"] is None  # of one SE


def test_axes_include_the_lowest_return_and_the_solved_reward(cartpole: Task) -> None:
    for scores in ([200.0, 199.0], [150.0, 140.0]):
        results = tuple(made_up_result(i, *[score] * 10) for i, score in enumerate(scores))
        with styled():
            figure = violins([Group("real", "ddqn", 195.0, results)], cartpole, lowest=9.0)
        low, high = figure.axes[0].get_ylim()
        assert -10 < low < 9
        assert 195 < high < 215
