"""Names of observations and actions, and the observations that plots show."""

from bilevel.tasks.compiled import Labels
from bilevel.tasks.task import COMPILED

#: Labels by the task's id without its version.
_LABELS = {task.id.partition("-")[0]: task.labels for task in COMPILED.values()} | {
    "MountainCar": Labels(("position", "velocity"), ("push left", "no push", "push right"))
}
_UNKNOWN = Labels((), ())


def observation_names(task_id: str, size: int) -> tuple[str, ...]:
    """Return the names of a task's observations, or numbered names if they are unknown."""
    names = _labels(task_id).observations
    return names if len(names) == size else tuple(f"observation {i}" for i in range(size))


def action_names(task_id: str, number: int) -> tuple[str, ...]:
    """Return the names of a task's actions, or numbered names if they are unknown."""
    names = _labels(task_id).actions
    return names if len(names) == number else tuple(f"action {i}" for i in range(number))


def picture_axes(task_id: str, size: int) -> tuple[int, int]:
    """Return the indices of the two observations that plots of the task show: by default the first
    two, or twice the only one."""
    i, j = _labels(task_id).axes
    return (i, j) if max(i, j) < size else (0, 1 % size)


def _labels(task_id: str) -> Labels:
    return _LABELS.get(task_id.partition("-")[0], _UNKNOWN)
