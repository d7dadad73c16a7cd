"""What stands in the folders of runs is read as it was written, or refused in one line."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from bilevel import InvalidInput
from bilevel.errors import OtherVersion
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.bohb.study.definition import Study
from cluster.evaluate.run import EvaluationSettings
from cluster.evaluate.view import EvaluationViews
from cluster.nes.run import NESRun
from cluster.storage.run_folder import finals, locked_settings
from tests.studies import new_study


def refused(read: Any, folder: Path, settings: dict[str, Any], told: str) -> None:
    before = (folder / "settings.json").read_text()
    (folder / "settings.json").write_text(json.dumps(json.loads(before) | settings))
    with pytest.raises(InvalidInput, match=rf"^[^\n]*{told}[^\n]*$"):
        read(folder)
    (folder / "settings.json").write_text(before)


def test_of_an_nes_run(cartpole: Task, small_hp: Hyperparameters, tmp_path: Path) -> None:
    run = NESRun(cartpole, small_hp, 3, tmp_path)
    with locked_settings(tmp_path, run.settings()):
        pass
    read = NESRun.read(tmp_path)
    assert read.settings() == run.settings()
    for settings, told in (
        ({"seed": -1}, "holds no NES run: seed: must be greater than or equal to 0; got -1"),
        ({"task": {}}, "holds no NES run: task: 'id' is missing"),
        ({"nes": {}}, "holds no NES run: nes: 'update' is missing"),
        ({"agents": {"mine": {}}}, "holds no NES run: unknown agent 'mine'"),
        ({"se": {"self": 1}}, "holds no NES run: unknown hyperparameter 'se.self'"),
        ({"colour": "red"}, "holds no NES run: unknown 'colour'"),
    ):
        refused(NESRun.read, tmp_path, settings, told)


def test_of_another_format(cartpole: Task, small_hp: Hyperparameters, tmp_path: Path) -> None:
    """What an incompatible version began is neither resumed nor taken for damaged."""
    run = NESRun(cartpole, small_hp, 3, tmp_path)
    with locked_settings(tmp_path, run.settings()):
        pass
    told = "has format 1, this version reads format [0-9]+: resume with the version that began it"
    refused(NESRun.read, tmp_path, {"format": 1}, told)
    path = tmp_path / "settings.json"
    settings = json.loads(path.read_text())
    del settings["format"]  # as before there were formats
    path.write_text(json.dumps(settings))
    with pytest.raises(OtherVersion, match=told), locked_settings(tmp_path, run.settings()):
        pass


def test_of_a_study(tmp_path: Path) -> None:
    study = new_study(tmp_path)
    with locked_settings(tmp_path, study.settings()):
        pass
    assert Study.read(tmp_path) == study
    for settings, told in (
        ({"budgets": [1, "3"]}, r"holds no study: budgets\[1\]: must be a valid integer; got '3'"),
        ({"cycle": 9}, "holds no study: a cycle of brackets must be 1 to 2"),
        ({"space": "huge"}, "holds no study: unknown search space 'huge'"),
        ({"method": "x"}, "holds no study: unknown method 'x'"),
        ({"base": {}}, "holds no study: 'base.nes' is missing"),
    ):
        refused(Study.read, tmp_path, settings, told)


def test_of_an_evaluation(cartpole: Task, small_hp: Hyperparameters, tmp_path: Path) -> None:
    (agent,) = small_hp.agents
    settings = {
        "kind": "evaluate",
        "task": asdict(cartpole),
        "seed": 0,
        "vary": "no",
        "sources": {"real": "real"},
        "kinds": {agent.agent: asdict(agent)},
    }
    with locked_settings(tmp_path, settings):
        pass
    assert EvaluationSettings.read(tmp_path).task == cartpole
    assert EvaluationViews.of(tmp_path).task_id == cartpole.id
    for name, wrong in (("sources", []), ("kinds", None), ("vary", 3), ("task", {"id": "../x"})):
        refused(EvaluationViews.of, tmp_path, {name: wrong}, "holds no evaluation: ")


@pytest.mark.parametrize("line", ["7", "{}", '{"step": 1, "time": 1, "metrics": {"a": null}}'])
def test_damaged_ends_are_told(line: str, tmp_path: Path) -> None:
    (tmp_path / "finals.jsonl").write_text(line + "\n")
    with pytest.raises(InvalidInput, match=r"finals.jsonl', line 1: "):
        finals(tmp_path)
