import pytest

from bilevel.tasks import Task, get_task
from bilevel.tasks.names import action_names, observation_names, picture_axes


@pytest.mark.parametrize("task", ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"])
def test_names_of_the_known_tasks(task: str) -> None:
    known: Task = get_task(task)
    observations = observation_names(task, known.state_size)
    actions = action_names(task, known.n_actions)
    assert len(set(observations)) == known.state_size
    assert len(set(actions)) == known.n_actions
    assert not any(name.startswith(("observation", "action")) for name in observations + actions)


def test_others_have_numbers() -> None:
    assert observation_names("Balance-v0", 2) == ("observation 0", "observation 1")
    assert action_names("CartPole-Swing-v0", 3) == ("action 0", "action 1", "action 2")


def test_pictures_are_over_two_observations_that_are_there() -> None:
    found = [picture_axes(*task) for task in (("CartPole-v0", 4), ("Acrobot-v1", 6))]
    assert found == [(2, 3), (4, 5)]
    assert picture_axes("Acrobot-small-v0", 3) == (0, 1)
    assert picture_axes("Balance-v0", 1) == (0, 0)
