"""Names of the observations and actions of some tasks, and the axes of their pictures."""

#: By the beginning of the task's id, in the order of the task.
_OBSERVATIONS = {
    "CartPole": (
        "cart position (m)",
        "cart velocity (m/s)",
        "pole angle (rad)",
        "pole velocity (rad/s)",
    ),
    "Acrobot": (
        "cosine of angle 1",
        "sine of angle 1",
        "cosine of angle 2",
        "sine of angle 2",
        "velocity of link 1 (rad/s)",
        "velocity of link 2 (rad/s)",
    ),
    "MountainCar": ("position", "velocity"),
}
_ACTIONS = {
    "CartPole": ("push left", "push right"),
    "Acrobot": ("torque -1", "torque 0", "torque +1"),
    "MountainCar": ("push left", "no push", "push right"),
}
#: The two observations over which pictures are drawn.
_AXES = {"CartPole": (2, 3), "Acrobot": (4, 5)}


def observation_names(task_id: str, size: int) -> tuple[str, ...]:
    """Names of the observations of a task that has so many; numbers, if none are known."""
    return _known(_OBSERVATIONS, task_id, size, "observation")


def action_names(task_id: str, number: int) -> tuple[str, ...]:
    """Names of the actions of a task that has so many; numbers, if none are known."""
    return _known(_ACTIONS, task_id, number, "action")


def picture_axes(task_id: str, size: int) -> tuple[int, int]:
    """Indices of the two observations, of so many, over which pictures of the task are drawn: the
    first ones if none are known, the only one twice."""
    i, j = _AXES.get(task_id.partition("-")[0], (0, 1))
    return (i, j) if max(i, j) < size else (0, 1 % size)


def _known(
    names: dict[str, tuple[str, ...]], task_id: str, number: int, usual: str
) -> tuple[str, ...]:
    found = names.get(task_id.partition("-")[0], ())
    return found if len(found) == number else tuple(f"{usual} {i}" for i in range(number))
