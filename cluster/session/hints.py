"""Options without which a command that a message tells its reader to type would do something else;
each begins with a space."""

import shlex

from bilevel.errors import InvalidInput
from bilevel.tasks import Task, get_task
from cluster.ray.agent_files import loaded_files
from cluster.storage.author import without_password


def task_options(task: Task) -> str:
    """The task's values that its id alone does not give."""
    usual = _usual(task)
    options = {
        name: getattr(task, name)
        for name in ("solved_reward", "step_limit")
        if usual is None or getattr(usual, name) != getattr(task, name)
    }
    usual = _usual(task, **options)
    if usual is None or usual.worst_score != task.worst_score:
        options["worst_score"] = task.worst_score
    return "".join(
        f" --{name.replace('_', '-')} {str(value).removesuffix('.0')}"
        for name, value in options.items()
    )


def _usual(task: Task, **values: float) -> Task | None:
    """The task that its id and these values give; None if they do not suffice."""
    try:
        return get_task(task.id, **values)  # type: ignore[arg-type]
    except InvalidInput:
        return None


def agent_options() -> str:
    """The agent files of this command."""
    return "".join(f" --agent-file {shlex.quote(path)}" for path in loaded_files())


def tracking_option(uri: str) -> str:
    """The MLflow of this command."""
    return f" --tracking-uri {shlex.quote(without_password(uri))}"
