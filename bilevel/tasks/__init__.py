"""Real tasks, on which agents are tested."""

from bilevel.tasks.adapter import RealEnv
from bilevel.tasks.source import EnvSource
from bilevel.tasks.specification import BUILT_IN_TASKS, get_task
from bilevel.tasks.task import MAX_STEP_LIMIT, ObservationScale, Task

__all__ = [
    "BUILT_IN_TASKS",
    "MAX_STEP_LIMIT",
    "EnvSource",
    "ObservationScale",
    "RealEnv",
    "Task",
    "get_task",
]
