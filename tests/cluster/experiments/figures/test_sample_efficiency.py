"""The ladder of episodes: a shorter training is the beginning of a longer one."""

from dataclasses import replace

import numpy as np
import pytest

from bilevel.evaluation import EvaluationResult, evaluate
from bilevel.hyperparameters import AgentHyperparameters, DDQNHyperparameters, load_recipe
from bilevel.tasks import Task, get_task
from cluster.experiments.agents import Found, Place, Source, Unit
from cluster.experiments.conditions import REAL
from cluster.experiments.figures.sample_efficiency import (
    climbed,
    ladder,
    learning_curves,
    scores_at,
    steps_and_scores,
)
from cluster.experiments.style import styled
from tests.cluster.experiments.made_up import result_of
from tests.ses import make_se


def base(first: int, last: int) -> AgentHyperparameters:
    (hp,) = load_recipe("paper", "").agents
    return replace(hp, init_episodes=first, max_episodes=last)


@pytest.mark.parametrize("ends", [(10, 1000), (0, 7), (1, 1), (3, 5), (20, 1000)])
def test_a_ladder_climbs_from_no_learning_to_the_maximum(ends: tuple[int, int]) -> None:
    rungs = ladder(base(*ends))
    assert rungs[0] == max(ends[0], 1)
    assert rungs[-1] == ends[1]
    assert rungs == sorted(set(rungs))
    assert len(rungs) < 22


@pytest.mark.parametrize("source", ["SE", "real", "gymnasium"])
def test_an_agent_that_stops_early_is_the_beginning_of_one_that_goes_on(
    source: str, small_agent: DDQNHyperparameters
) -> None:
    """The tests of the longer training, taken in between by one with a stopping rule that holds at
    that very episode, are those of the shorter one."""
    task = get_task("MountainCar-v0" if source == "gymnasium" else "CartPole-v0")
    task = replace(task, step_limit=min(task.step_limit, 60))
    se = Source("default", 0, make_se(task)) if source == "SE" else Source(REAL)
    agent = replace(small_agent, init_episodes=2, early_out_episodes=4, max_episodes=40)
    # A rule that always holds: training stops as soon as it is asked.
    stopping = replace(agent, early_out_difference=1e6)
    asks = replace(task, solved_reward=-1e9)
    unit = Unit(asks if se.se is None else task, se, Place(0, 0), stopping, 7)
    stopped = result(unit)
    episodes = stopped.train_episodes
    assert 3 < episodes < 10
    cut = result(replace(unit, task=task, hp=replace(agent, max_episodes=episodes)))
    assert cut.test_returns == stopped.test_returns
    assert cut.train_steps == stopped.train_steps
    assert cut.train_episodes == episodes


def result(unit: Unit) -> EvaluationResult:
    se = unit.source.se
    return evaluate(unit.task, se.se if se else None, unit.request(0))


def unit_of(task: Task, first: int = 10, last: int = 1000) -> Unit:
    return Unit(task, Source(REAL), Place(0, 0), base(first, last), 3)


def test_an_agent_climbs_until_it_stops_by_itself(cartpole: Task) -> None:
    unit, found = unit_of(cartpole), Found()
    for _ in range(30):
        rungs, done = climbed(unit, found)
        if done:
            break
        limit = rungs[-1].hp.max_episodes
        found[rungs[-1].key] = replace(result_of(rungs[-1]), train_episodes=min(limit, 33))
    assert [rung.hp.max_episodes for rung in rungs] == [10, 14, 20, 28, 39]
    steps, scores = steps_and_scores(unit, found)
    assert steps.shape == scores.shape == (5,)


def test_an_agent_that_never_stops_climbs_to_the_top(cartpole: Task) -> None:
    unit, found = unit_of(cartpole, 3, 5), Found()
    while not climbed(unit, found)[1]:
        rung = climbed(unit, found)[0][-1]
        found[rung.key] = result_of(rung)
    assert [rung.hp.max_episodes for rung in climbed(unit, found)[0]] == [3, 4, 5]


def test_curves_keep_their_first_and_last_values() -> None:
    curves = [
        (np.array([10.0, 20.0]), np.array([1.0, 2.0])),
        (np.array([15.0, 40.0]), np.array([5.0, 9.0])),
    ]
    found = scores_at(np.array([5.0, 10.0, 19.9, 20.0, 100.0]), curves)
    np.testing.assert_array_equal(found, [[1, 1, 1, 2, 2], [5, 5, 5, 5, 9]])


def test_agents_on_one_se_are_one_sample(cartpole: Task) -> None:
    """The band is the standard error over SEs: here of two, whose agents score 10 and 30 on one and
    50 and 70 on the other."""
    steps = np.array([10.0, 1000.0])
    each = [(steps, np.full(2, score)) for score in (10.0, 30.0, 50.0, 70.0)]
    with styled():
        over_ses, over_agents = (
            learning_curves({"default": each}, {"default": samples}, cartpole, "ddqn").axes[0]
            for samples in (2, 4)
        )
    for axes, error in ((over_ses, 20.0), (over_agents, np.sqrt(2000 / 3) / 2)):
        heights = np.concatenate([path.vertices for path in axes.collections[0].get_paths()])[:, 1]
        assert (heights.min(), heights.max()) == pytest.approx((40 - error, 40 + error))
