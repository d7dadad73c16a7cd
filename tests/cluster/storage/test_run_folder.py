import errno
import fcntl
import json
import multiprocessing
import os
import sys
from pathlib import Path

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


def test_the_very_setting_that_differs_is_named(tmp_path: Path) -> None:
    begun = {"nes": {"population_size": 32, "step_size": 1.0}, "agents": {"ddqn": {"discount": 1}}}
    with locked_settings(tmp_path / "run", begun):
        pass
    for now, told in (
        (
            {**begun, "nes": {"population_size": 16, "step_size": 1.0}},
            "nes.population_size = 32, not 16:",
        ),
        ({**begun, "agents": {"td3": {}}}, "agents.ddqn = {'discount': 1}, not None:"),
        ({**begun, "seed": 1}, "seed = None, not 1:"),
    ):
        with pytest.raises(InvalidInput, match=told), locked_settings(tmp_path / "run", now):
            pass


def test_other_settings_are_refused(tmp_path: Path) -> None:
    with locked_settings(tmp_path / "run", {"seed": 1, "budgets": (1, 3)}) as identity:
        pass
    with locked_settings(tmp_path / "run", {"seed": 1, "budgets": (1, 3)}) as again:
        assert identity == again
    with (
        pytest.raises(InvalidInput, match="'run' was begun with seed = 1, not 2"),
        locked_settings(tmp_path / "run", {"seed": 2, "budgets": (1, 3)}),
    ):
        pass


def test_changed_code_is_kept_and_told(tmp_path: Path) -> None:
    """A mistake in an agent may be mended, and the run goes on; it tells that its code changed."""

    def run(*code: str, folder: Path = tmp_path / "run") -> str:
        digests = {"agent 'mine'": list(code)} if code else {}
        with locked_settings(folder, {"seed": 1, "code": digests}) as identity:
            assert identity == RunIdentity.read(folder)
        return identity.mixture

    assert [run("one"), run("one")] == ["", ""]
    assert run("two").startswith("Begun and resumed with 2 versions of the agent 'mine'")
    assert run("one").startswith("Begun and resumed with 2 versions")
    # Earlier versions of this package stored no digests.
    assert [run(folder=tmp_path / "old"), run("one", folder=tmp_path / "old")] == ["", ""]
    check_settings(tmp_path / "run", {"seed": 1, "code": {"agent 'mine'": ["three"]}})
    assert "2 versions" in RunIdentity.read(tmp_path / "run").mixture


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", "nonsense", '{"uuid": "\' OR 1=1", "began": 0}', '{"uuid": 7}'],
)
def test_damaged_settings_are_told(content: str, tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_text(content)
    with pytest.raises(InvalidInput, match="damaged settings"), locked_settings(tmp_path, {}):
        pass


def test_two_at_once_are_refused(tmp_path: Path) -> None:
    with (
        locked_settings(tmp_path / "run", {}),
        pytest.raises(InvalidInput, match="run by another process"),
        locked_settings(tmp_path / "run", {}),
    ):
        pass


def _hold_for_ever(folder: Path, taken: "multiprocessing.synchronize.Event") -> None:
    with held(folder):
        taken.set()
        multiprocessing.Event().wait()


def test_the_lock_of_a_killed_process_is_free(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    taken = context.Event()
    process = context.Process(target=_hold_for_ever, args=(tmp_path, taken))
    process.start()
    assert taken.wait(60)
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
    assert run_status.ended_as == "KILLED"
    assert RunStatus("FINISHED", 0.0, 1).ended_as == "FINISHED"


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[1, 2, 3]",
        '{"status": "RUNNING"}',
        '{"status": "ASLEEP", "since": 1, "target": 1}',
        '{"status": "RUNNING", "since": NaN, "target": 1}',
        '{"status": "RUNNING", "since": 1, "target": "all"}',
    ],
)
def test_damaged_status_is_told(content: str, tmp_path: Path) -> None:
    (tmp_path / "status.json").write_text(content)
    with pytest.raises(InvalidInput, match=r"damaged|unknown status"):
        RunStatus.load(tmp_path)


def test_an_end_is_written_once(tmp_path: Path) -> None:
    add_final(tmp_path, Final(6, 1.0, {"score": 2.0}))
    add_final(tmp_path, Final(6, 9.0, {"score": 2.0}))  # killed just after, and run again
    add_final(tmp_path, Final(8, 9.0, {"score": 3.0}))
    assert [final.step for final in finals(tmp_path)] == [6, 8]
    add_final(tmp_path, Final(8, 10.0, {"score": 4.0}))  # no new result, but another best SE
    assert [final.metrics["score"] for final in finals(tmp_path)] == [2.0, 3.0, 4.0]


def test_what_a_killed_process_was_writing_is_removed(tmp_path: Path) -> None:
    stray = tmp_path / "configurations" / "000-0-000" / ".state.safetensors.77.tmp"
    stray.parent.mkdir(parents=True)
    stray.touch()
    with held(tmp_path):
        assert not stray.exists()


def test_begun_stays_the_same(tmp_path: Path) -> None:
    with locked_settings(tmp_path / "run", {"seed": 1}) as begun:
        assert RunIdentity.read(tmp_path / "run") == begun


def test_a_stored_task_asks_gymnasium_for_nothing(tmp_path: Path) -> None:
    facts = json.loads(
        '{"id": "antigravity:Env-v0", "state_size": 2, "n_actions": 2, "step_limit": 9, '
        '"solved_reward": 1.0, "worst_score": 0.0, "dynamics": 0}'
    )
    assert stored_task(facts).id == "antigravity:Env-v0"
    assert "antigravity" not in sys.modules
    wrong_facts = (("step_limit", 0), ("state_size", "4"), ("id", None), ("id", "../x"))
    for name, wrong in (*wrong_facts, ("extra", 1)):
        with pytest.raises((TypeError, ValueError)):
            stored_task({**facts, name: wrong})


def test_a_lock_that_the_kernel_refuses_to_test_counts_as_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """NFS locks only what is open for writing, and answers with an error else."""

    def of_nfs(file: int, operation: int) -> None:
        if fcntl.fcntl(file, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(errno.EBADF, "Bad file descriptor")
        flock(file, operation)

    flock = fcntl.flock
    with held(tmp_path):
        monkeypatch.setattr(fcntl, "flock", of_nfs)
        assert is_held(tmp_path)
        monkeypatch.setattr(os, "O_RDWR", os.O_RDONLY)  # a folder that one may only read
        assert not is_held(tmp_path)
