"""The authors' figures and the formatted tables. tests/system covers the page."""

from pathlib import Path

from bilevel.tasks import BUILT_IN_TASKS
from cluster.evaluate.report import Row, shown, table
from cluster.experiments.authors import authors_figures, comparison
from cluster.experiments.figures import EXPERIMENTS
from tests.cluster.experiments.artificial import findings_of


def test_every_figure_of_the_authors_has_a_source() -> None:
    for figure in authors_figures():
        assert figure.source in ("paper", "repository", "curves in the repository")
        assert figure.task in BUILT_IN_TASKS
        assert figure.experiment in EXPERIMENTS
        assert figure.evaluations


def test_every_figure_of_the_authors_has_one_of_ours(tmp_path: Path) -> None:
    summaries = {
        name: findings_of(EXPERIMENTS[name], tmp_path).summary
        for name in ("success", "transfer", "behaviour")
    }
    rows = comparison("CartPole-v0", summaries)
    assert len(rows) == sum(f.task == "CartPole-v0" for f in authors_figures())
    for row in rows:
        # The first needs five SEs, the second a run that solves the task.
        if row["figure"] not in ("five best ses", "median first solved"):
            assert (row["ours, same condition"], row["ours, default recipe"]) != ("-", "-")
    by_name = {(row["condition"], row["figure"]): row for row in rows}
    steps = by_name["td3; SE, HP varied", "train steps"]
    assert steps["authors"] == "5,832 ± 1,577"
    assert steps["evaluations (authors)"] == "400 agents"
    assert steps["ours, same condition"] == "200.0 ± 0"
    assert by_name["ddqn; real task", "test return"]["ours, default recipe"] == "-"


def test_comparison_without_experiments() -> None:
    rows = comparison("Acrobot-v1", {})
    assert rows
    assert all(row["ours, same condition"] == row["ours, default recipe"] == "-" for row in rows)
    assert comparison("MountainCar-v0", {}) == []


def test_digits() -> None:
    texts = ("-", "ddqn", "7", "4,000", "16,888", "190.7", "0.35", "0", "0.00034")
    values = (None, "ddqn", 7, 4000, 16888.4, 190.666, 0.35, 0.0, 0.00034)
    assert tuple(map(shown, values)) == texts


def test_table_joins_means_and_standard_deviations() -> None:
    rows: list[Row] = [{"agent": "ddqn", "ses": 20.0, "ses_std": 1.5}, {"agent": "td3"}]
    found = table(rows).to_dict("list")
    assert found == {"agent": ["ddqn", "td3"], "ses": ["20.0 ± 1.5", "-"]}
