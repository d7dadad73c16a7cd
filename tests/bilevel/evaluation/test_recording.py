from dataclasses import replace

import pytest

from bilevel.errors import InvalidInput
from bilevel.evaluation import record, train_and_test
from bilevel.hyperparameters import DDQNHyperparameters
from bilevel.tasks import Task, get_task
from tests.ses import make_se


@pytest.mark.parametrize("task_id", ["CartPole-v0", "MountainCar-v0"])
def test_a_recording_has_all_transitions(task_id: str, small_agent: DDQNHyperparameters) -> None:
    task = replace(get_task(task_id), step_limit=20)
    hp = replace(small_agent, init_episodes=3, max_episodes=5)
    recording = record(task, make_se(task).se, hp, 5)
    outcome = train_and_test(task, make_se(task).se, hp, 5, compiled=False)
    assert len(recording.training) == outcome.train_steps
    assert len(recording.tests) == outcome.real_env_steps
    total = sum(transition.reward for transition in recording.tests)
    assert total / hp.test_episodes == pytest.approx(outcome.score)


@pytest.mark.parametrize("evaluate", [record, train_and_test])
def test_an_se_of_another_task_is_rejected(
    evaluate: object, cartpole: Task, acrobot: Task, small_agent: DDQNHyperparameters
) -> None:
    with pytest.raises(InvalidInput, match="Acrobot-v1 has 6 and 3"):
        evaluate(acrobot, make_se(cartpole).se, small_agent, 5)  # type: ignore[operator]
