"""Settings in run folders are read as they were written, or refused in one line."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from bilevel import InvalidInput
from bilevel.errors import OtherVersion
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.bohb.study.definition import Study
from cluster.nes.run import NESRun
from cluster.storage.run_folder import locked_settings
from tests.studies import new_study


def assert_refused(read: Any, folder: Path, settings: dict[str, Any], message: str) -> None:
    before = (folder / "settings.json").read_text()
    (folder / "settings.json").write_text(json.dumps(json.loads(before) | settings))
    with pytest.raises(InvalidInput, match=rf"^[^\n]*{re.escape(message)}[^\n]*$"):
        read(folder)
    (folder / "settings.json").write_text(before)


def test_nes_run(cartpole: Task, small_hp: Hyperparameters, tmp_path: Path) -> None:
    run = NESRun(cartpole, small_hp, 3, tmp_path)
    with locked_settings(tmp_path, run.settings()):
        pass
    assert NESRun.read(tmp_path).settings() == run.settings()
    for settings, message in (
        ({"seed": -1}, "holds no NES run: seed: must be greater than or equal to 0; got -1"),
        ({"task": {}}, "holds no NES run: task: 'id' is missing"),
        ({"agents": {"mine": {}}}, "holds no NES run: unknown agent 'mine'"),
        ({"se": {"self": 1}}, "holds no NES run: unknown 'se.self'"),
        ({"colour": "red"}, "holds no NES run: unknown 'colour'"),
    ):
        assert_refused(NESRun.read, tmp_path, settings, message)


def test_another_format_is_not_resumed(
    cartpole: Task, small_hp: Hyperparameters, tmp_path: Path
) -> None:
    settings = NESRun(cartpole, small_hp, 3, tmp_path).settings()
    with locked_settings(tmp_path, settings):
        pass
    path = tmp_path / "settings.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"format": 99}))
    with pytest.raises(OtherVersion, match="has format 99"), locked_settings(tmp_path, settings):
        pass


def test_study(tmp_path: Path) -> None:
    study = new_study(tmp_path)
    with locked_settings(tmp_path, study.settings()):
        pass
    assert Study.read(tmp_path) == study
    for settings, message in (
        ({"budgets": [1, "3"]}, "holds no study: budgets[1]: must be a valid integer; got '3'"),
        ({"base": {}}, "holds no study: 'base.nes' is missing"),
    ):
        assert_refused(Study.read, tmp_path, settings, message)
