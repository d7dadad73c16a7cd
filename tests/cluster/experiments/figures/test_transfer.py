"""Statistics of test returns."""

from pathlib import Path

import pytest

from cluster.experiments.figures.transfer import TRANSFER
from cluster.experiments.sizes import SIZES
from tests.cluster.experiments.artificial import findings_of


def test_summary_covers_the_agents_of_each_source(tmp_path: Path) -> None:
    findings, size = findings_of(TRANSFER, tmp_path), SIZES["smoke"]
    groups = findings.data.groupby(["agent", "source"])
    for row in findings.summary:
        on_real = row["source"] == "real"
        assert row["agents"] == (size.real_agents if on_real else size.ses * size.agents)
        scores = groups.get_group((row["agent"], row["source"]))["score"]
        assert row["test_return"] == pytest.approx(scores.mean())
        assert row["standard_error_over_ses"] is None  # of one SE
