"""Objects that commands build from their options."""

import json
from dataclasses import asdict, replace
from pathlib import Path

from bilevel.tasks import get_task
from cluster.cli.run_options import RunOptions
from cluster.storage.run_folder import SETTINGS_FILE


def test_a_run_keeps_the_first_measurement_of_a_steps_time(tmp_path: Path) -> None:
    task = get_task("FrozenLake-v1")
    assert task.step_seconds == 5e-5
    measured = RunOptions.measured(task, tmp_path)
    assert 0.0 < measured.step_seconds < 0.1
    stored = asdict(replace(task, measured_step_seconds=0.25))
    (tmp_path / SETTINGS_FILE).write_text(json.dumps({"task": stored}))
    assert RunOptions.measured(task, tmp_path).step_seconds == 0.25


def test_tasks_with_compiled_dynamics_are_not_measured(tmp_path: Path) -> None:
    task = get_task("CartPole-v0")
    assert RunOptions.measured(task, tmp_path) == task
