import json
import multiprocessing
import sys
from pathlib import Path
from typing import Any

import pytest

from bilevel import InvalidInput
from cluster.storage.run_folder import (
    Final,
    RunIdentity,
    RunStatus,
    add_final,
    check_settings,
    finals,
    held,
    is_held,
    locked_settings,
    stored_task,
)

SETTINGS = {
    "seed": 1,
    "nes": {"population_size": 32, "step_size": 1.0},
    "agents": {"ddqn": {"discount": 1}},
    "budgets": (1, 3),
}


def test_unchanged_settings_keep_the_identity(tmp_path: Path) -> None:
    with locked_settings(tmp_path / "run", SETTINGS) as identity:
        pass
    with locked_settings(tmp_path / "run", SETTINGS) as again:
        assert again == identity == RunIdentity.read(tmp_path / "run")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"nes": {"population_size": 16, "step_size": 1.0}},
            "'run' was started with nes.population_size = 32, not 16: use that value, or another",
        ),
        ({"agents": {"td3": {}}}, "agents.ddqn = {'discount': 1}, not None:"),
        ({"prior": "none"}, "prior = None, not none:"),
    ],
)
def test_messages_name_the_setting_that_differs(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with locked_settings(tmp_path / "run", SETTINGS):
        pass
    with (
        pytest.raises(InvalidInput, match=message),
        locked_settings(tmp_path / "run", SETTINGS | changes),
    ):
        pass
    with pytest.raises(InvalidInput, match=message):
        check_settings(tmp_path / "run", SETTINGS | changes)


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", "nonsense", '{"uuid": "\' OR 1=1", "began": 0}', '{"uuid": 7}']
)
def test_damaged_settings_are_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_text(content)
    with pytest.raises(InvalidInput, match="damaged settings"), locked_settings(tmp_path, {}):
        pass


def test_a_second_process_is_refused(tmp_path: Path) -> None:
    with (
        locked_settings(tmp_path / "run", {}),
        pytest.raises(InvalidInput, match="run by another process"),
        locked_settings(tmp_path / "run", {}),
    ):
        pass


def hold(folder: Path, locked: "multiprocessing.synchronize.Event") -> None:
    with held(folder):
        locked.set()
        multiprocessing.Event().wait()


def test_the_lock_of_a_killed_process_is_free(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    locked = context.Event()
    process = context.Process(target=hold, args=(tmp_path, locked))
    process.start()
    assert locked.wait(60)
    assert is_held(tmp_path)
    process.kill()
    process.join()
    assert not is_held(tmp_path)
    with held(tmp_path):
        pass


def test_status_round_trip(tmp_path: Path) -> None:
    assert RunStatus.load(tmp_path) is None
    run_status = RunStatus("RUNNING", 12.5, 3)
    run_status.save(tmp_path)
    assert RunStatus.load(tmp_path) == run_status


@pytest.mark.parametrize(
    "content",
    [
        "",
        '{"status": "RUNNING", "since": NaN, "target": 1}',
        '{"status": "ASLEEP", "since": 1, "target": 1}',
    ],
)
def test_a_damaged_status_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "status.json").write_text(content)
    with pytest.raises(InvalidInput, match="damaged"):
        RunStatus.load(tmp_path)


def test_an_end_is_recorded_once(tmp_path: Path) -> None:
    add_final(tmp_path, Final(6, 1.0, {"score": 2.0}))
    add_final(tmp_path, Final(6, 9.0, {"score": 2.0}))  # resumed after a kill
    add_final(tmp_path, Final(8, 9.0, {"score": 3.0}))
    add_final(tmp_path, Final(8, 10.0, {"score": 4.0}))  # another best SE
    assert [(final.step, final.metrics["score"]) for final in finals(tmp_path)] == [
        (6, 2.0),
        (8, 3.0),
        (8, 4.0),
    ]


def test_temporary_files_of_a_killed_process_are_removed(tmp_path: Path) -> None:
    stray = tmp_path / "configurations" / "000-0-000" / ".state.safetensors.77.tmp"
    stray.parent.mkdir(parents=True)
    stray.touch()
    with held(tmp_path):
        assert not stray.exists()


def test_a_stored_task_is_read_without_gymnasium(tmp_path: Path) -> None:
    facts = json.loads(
        '{"id": "antigravity:Env-v0", "state_size": 2, "action_size": 2, "step_limit": 9, '
        '"solved_reward": 1.0, "worst_score": 0.0, "dynamics": 0}'
    )
    assert stored_task(facts).id == "antigravity:Env-v0"
    assert "antigravity" not in sys.modules
    wrong_facts = (("step_limit", 0), ("state_size", "4"), ("id", None), ("id", "../x"))
    for name, wrong in (*wrong_facts, ("extra", 1)):
        with pytest.raises(InvalidInput):
            stored_task({**facts, name: wrong})
