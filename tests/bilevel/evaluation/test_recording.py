from dataclasses import replace

import pytest

from bilevel.errors import InvalidInput
from bilevel.evaluation import record, train_and_test
from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.tasks import get_task
from tests.ses import make_se


@pytest.fixture
def short_agent(small_agent: DDQNHyperparameters) -> DDQNHyperparameters:
    return replace(small_agent, init_episodes=3, max_episodes=5)


@pytest.mark.parametrize("task_id", ["CartPole-v0", "MountainCar-v0"])
def test_the_recorded_agent_is_the_one_that_is_tested(
    task_id: str, short_agent: DDQNHyperparameters
) -> None:
    task = replace(get_task(task_id), step_limit=20)
    se = make_se(task).se
    recording = record(task, se, short_agent, 5)
    outcome = train_and_test(task, se, short_agent, 5, compiled=False)
    assert len(recording.training) == outcome.train_steps
    assert len(recording.tests) == outcome.real_env_steps
    total = sum(one.reward for one in recording.tests) / short_agent.test_episodes
    assert total == pytest.approx(outcome.score)


def test_an_se_of_another_task_is_refused(short_agent: DDQNHyperparameters) -> None:
    with pytest.raises(InvalidInput, match="Acrobot-v1 has 6 and 3"):
        record(get_task("Acrobot-v1"), make_se(get_task("CartPole-v0")).se, short_agent, 5)
