"""Objects that commands build from their options."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from bilevel.tasks import get_task
from cluster.cli.run_options import RunOptions
from cluster.storage.run_folder import SETTINGS_FILE


def options(task: str) -> RunOptions:
    names = "agents", "address", "tracking_uri", "solved_reward", "step_limit"
    nothing: dict[str, Any] = dict.fromkeys(names)
    return RunOptions(task=task, seed=0, agent_files=(), home=Path(), **nothing)


def test_a_run_keeps_the_first_measurement_of_a_steps_time(tmp_path: Path) -> None:
    task = options("FrozenLake-v1").the_task(timed=True)
    assert 0.0 < task.step_seconds < 0.1
    assert RunOptions.resumed(task, tmp_path) == task
    stored = asdict(replace(task, measured_step_seconds=0.25))
    (tmp_path / SETTINGS_FILE).write_text(json.dumps({"task": stored}))
    assert RunOptions.resumed(task, tmp_path).step_seconds == 0.25


@pytest.mark.parametrize(("name", "timed"), [("CartPole-v0", True), ("FrozenLake-v1", False)])
def test_other_tasks_have_typical_times(name: str, timed: bool) -> None:
    """Compiled ones, and those of commands that train on given SEs."""
    assert options(name).the_task(timed) == get_task(name)
