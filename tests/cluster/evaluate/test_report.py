"""Table and picture of an evaluation."""

from dataclasses import replace

import numpy as np
import pytest

from bilevel.tasks import Task
from cluster.evaluate.report import Group, as_table, groups_of, picture
from tests.results import made_up_result


def group(agents: int, source: str = "my_se", spread: float = 10.0) -> Group:
    scores = 180 + spread * np.random.default_rng(agents).standard_normal(agents)
    results = [
        made_up_result(i, *(float(score),) * 10, train_steps=900 + i, train_episodes=40)
        for i, score in enumerate(scores)
    ]
    return Group(source, "ddqn", 195.0, tuple(results))


@pytest.mark.parametrize("found", [group(1), group(5), group(30, spread=0.0)])
def test_the_picture_has_a_point_per_agent(found: Group, cartpole: Task) -> None:
    axes = picture([found, group(3, "other")], cartpole, "title").axes[0]
    points = np.asarray(axes.collections[0].get_offsets())
    np.testing.assert_allclose(points[:, 1], found.scores)


def test_the_table_fits_80_columns() -> None:
    lines = as_table([group(5), group(40, "real")]).splitlines()
    assert lines[1].split()[:5] == ["my_se", "ddqn", "5", "178.4", "±"]
    assert max(map(len, lines)) <= 80


def test_a_diverged_agent_scores_no_better_than_the_others_of_all_groups() -> None:
    """The worst score of a task with penalties may be above all scores."""
    diverged = replace(made_up_result(1, 0.0, 0.0), finite=False)
    one, other = groups_of(
        {
            ("one", "ddqn"): [made_up_result(0, -200.0, -400.0), diverged],
            ("other", "ddqn"): [diverged, made_up_result(0, -150.0), diverged],
        },
        solved_reward=200.0,
    )
    assert (one.source, other.source) == ("one", "other")
    assert one.test_returns.tolist() == [-200.0, -400.0, -300.0, -300.0]
    assert other.scores.tolist() == [-300.0, -150.0, -300.0]
    assert [line.split()[-1] for line in as_table([one, other]).splitlines()[1:]] == ["1", "2"]
