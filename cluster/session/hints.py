"""Options that messages add to the commands that they suggest. Each starts with a space."""

import shlex
from contextlib import suppress

from bilevel.errors import InvalidInput
from bilevel.tasks import Task, get_task
from cluster.ray.agent_files import LOADED
from cluster.storage.author import without_password


def task_options(task: Task) -> str:
    """Return options for the values of a task that differ from the defaults of its id."""
    default: Task | None = None
    with_values = get_task(task.id, task.solved_reward, task.step_limit)
    with suppress(InvalidInput):  # the id alone may not define the task
        default = get_task(task.id)
    names = [
        name
        for name in ("solved_reward", "step_limit")
        if default is None or getattr(default, name) != getattr(task, name)
    ]
    if with_values.worst_score != task.worst_score:
        names.append("worst_score")
    return "".join(
        f" --{name.replace('_', '-')} {str(getattr(task, name)).removesuffix('.0')}"
        for name in names
    )


def agent_options() -> str:
    """Return options for the agent files of this command."""
    return "".join(f" --agent-file {shlex.quote(file.path)}" for file in LOADED)


def tracking_option(uri: str) -> str:
    """Return the option for an MLflow server or database, without its password."""
    return f" --tracking-uri {shlex.quote(without_password(uri))}"
