"""Learning curves from trainings with increasing episode limits."""

from dataclasses import replace

import numpy as np
import pytest

from bilevel.evaluation import (
    Centre,
    EvaluationRequest,
    EvaluationResult,
    RealTask,
    evaluate,
)
from bilevel.hyperparameters import AgentHyperparameters, DDQNHyperparameters
from bilevel.recipes import load_recipe
from bilevel.tasks import Task, get_task
from cluster.experiments.conditions import REAL
from cluster.experiments.experiment import Evaluation, Found, Source
from cluster.experiments.figures.sample_efficiency import (
    episode_limits,
    scores_at,
    shorter_trainings,
)
from tests.cluster.experiments.artificial import result_of
from tests.ses import make_se


def agent(first: int, last: int) -> AgentHyperparameters:
    (hp,) = load_recipe("paper", "").agents
    return replace(hp, init_episodes=first, max_episodes=last)


@pytest.mark.parametrize("ends", [(10, 1000), (0, 7), (1, 1), (3, 5), (20, 1000)])
def test_episode_limits_increase_to_the_maximum(ends: tuple[int, int]) -> None:
    limits = episode_limits(agent(*ends))
    assert limits[0] == max(ends[0], 1)
    assert limits[-1] == ends[1]
    assert limits == sorted(set(limits))
    assert len(limits) < 22


@pytest.mark.parametrize("source", ["SE", "real", "gymnasium"])
def test_a_longer_training_passes_through_the_agent_of_a_shorter_one(
    source: str, small_agent: DDQNHyperparameters
) -> None:
    """An agent that stops by its rule after n episodes equals one with the limit n."""
    task = get_task("FrozenLake-v1" if source == "gymnasium" else "CartPole-v0")
    task = replace(task, step_limit=min(task.step_limit, 60))
    se = Source("default", 0, make_se(task)) if source == "SE" else Source(REAL)
    unlimited = replace(small_agent, init_episodes=2, early_out_episodes=4, max_episodes=40)
    # Rules that hold at the first check.
    stopping = replace(unlimited, early_out_difference=1e6)
    solved = replace(task, solved_reward=-1e9)
    evaluation = Evaluation(solved if se.se is None else task, se, "0-0", stopping, 7)
    stopped = result(evaluation)
    episodes = stopped.train_episodes
    assert 3 < episodes < 10
    cut = result(replace(evaluation, task=task, hp=replace(unlimited, max_episodes=episodes)))
    assert cut.test_returns == stopped.test_returns
    assert (cut.train_steps, cut.train_episodes) == (stopped.train_steps, episodes)


def result(evaluation: Evaluation) -> EvaluationResult:
    se, on = evaluation.source.se, Centre() if evaluation.source.se else RealTask()
    request = EvaluationRequest(0, evaluation.seed, evaluation.hp, on)
    return evaluate(evaluation.task, se, request)


@pytest.mark.parametrize(
    ("ends", "stop", "limits"), [((10, 1000), 33, [10, 14, 20, 28, 39]), ((3, 5), 99, [3, 4, 5])]
)
def test_trainings_end_with_the_one_that_stops_by_its_rule(
    ends: tuple[int, int], stop: int, limits: list[int], cartpole: Task
) -> None:
    evaluation, found = Evaluation(cartpole, Source(REAL), "0-0", agent(*ends), 3), Found()
    for _ in range(30):
        last = shorter_trainings(evaluation, found)[-1]
        found[last.key] = replace(result_of(last), train_episodes=min(last.hp.max_episodes, stop))
    trainings = shorter_trainings(evaluation, found)
    assert [one.hp.max_episodes for one in trainings] == limits
    assert len(found) == len(limits)


def test_curves_keep_their_first_and_last_scores() -> None:
    curves = [
        (np.array([10.0, 20.0]), np.array([1.0, 2.0])),
        (np.array([15.0, 40.0]), np.array([5.0, 9.0])),
    ]
    found = scores_at(np.array([5.0, 10.0, 19.9, 20.0, 100.0]), curves)
    np.testing.assert_array_equal(found, [[1, 1, 1, 2, 2], [5, 5, 5, 5, 9]])
