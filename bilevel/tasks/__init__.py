"""The real tasks and their fixed values."""

from bilevel.tasks.actions import checked_action
from bilevel.tasks.task import BUILT_IN_TASKS, MAX_STEP_LIMIT, ObservationScale, Task, get_task

__all__ = [
    "BUILT_IN_TASKS",
    "MAX_STEP_LIMIT",
    "ObservationScale",
    "Task",
    "checked_action",
    "get_task",
]
