"""The report of an evaluation: its table and its picture."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from bilevel.tasks import Task
from cluster.evaluate.pictures import VIOLIN_FROM, returns
from cluster.evaluate.report import Group, as_table, groups_of
from cluster.pictures import png
from tests.results import made_up_result


def group(agents: int, source: str = "my_se", spread: float = 10.0) -> Group:
    scores = 180 + spread * np.random.default_rng(agents).standard_normal(agents)
    results = [
        made_up_result(i, *(float(score),) * 10, train_steps=900 + i, train_episodes=40)
        for i, score in enumerate(scores)
    ]
    return Group(source, "ddqn", 195.0, tuple(results))


@pytest.mark.parametrize(("agents", "violins"), [(5, 0), (VIOLIN_FROM, 2)])
def test_a_violin_needs_enough_agents(agents: int, violins: int, cartpole: Task) -> None:
    """Of every agent there is a point, in scores and in train steps."""
    found = group(agents)
    figure = returns([found], cartpole, "few")
    drawn = [one for axes in figure.axes for one in axes.collections]
    assert sum(isinstance(one, PolyCollection) for one in drawn) == violins
    points = [np.asarray(one.get_offsets()) for one in figure.axes[0].collections]
    assert any(len(p) == agents and np.allclose(p[:, 1], found.scores) for p in points), (
        "a point of every agent"
    )
    assert f"n = {agents}" in figure.axes[1].get_xticklabels()[0].get_text()
    assert "few" in figure.axes[0].get_title()


def test_one_agent_and_equal_scores_are_drawn_too(cartpole: Task) -> None:
    assert png(returns([group(1), group(30, "other", spread=0.0)], cartpole, "few"))


def test_the_table_fits_80_columns() -> None:
    lines = as_table([group(5), group(40, "real")])
    assert [len(line.split()) for line in lines[1:]] == [13, 13]
    assert max(map(len, lines)) <= 80


def test_a_diverged_agent_is_no_better_than_the_others_of_all_groups() -> None:
    """The worst score of a task with penalties may lie above all that agents get."""
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
    assert other.summary()["non_finite"] == 2
    assert as_table([one, other])[3:] == [
        "1 of 2 ddqn agents on one diverged: the lowest score each",
        "2 of 3 ddqn agents on other diverged: the lowest score each",
    ]
