import pytest

from bilevel.tasks import get_task
from bilevel.tasks.names import action_names, observation_names, picture_axes


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"])
def test_names_of_known_tasks(task_id: str) -> None:
    task = get_task(task_id)
    names = observation_names(task_id, task.state_size), action_names(task_id, task.n_actions)
    assert [len(set(group)) for group in names] == [task.state_size, task.n_actions]
    assert not any(name.startswith(("observation", "action")) for name in sum(names, ()))


def test_names_of_unknown_tasks_are_numbered() -> None:
    assert observation_names("Balance-v0", 2) == ("observation 0", "observation 1")
    assert action_names("CartPole-Swing-v0", 3) == ("action 0", "action 1", "action 2")


@pytest.mark.parametrize(
    ("task_id", "size", "axes"),
    [
        ("CartPole-v0", 4, (2, 3)),
        ("Acrobot-v1", 6, (4, 5)),
        ("Acrobot-small-v0", 3, (0, 1)),
        ("Balance-v0", 1, (0, 0)),
    ],
)
def test_plots_show_two_observations(task_id: str, size: int, axes: tuple[int, int]) -> None:
    assert picture_axes(task_id, size) == axes
