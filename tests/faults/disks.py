"""Faults of disks and files: a full disk, a truncated line, a damaged checkpoint, a held lock."""

import shutil
import signal
import subprocess
from collections.abc import Callable
from dataclasses import replace

from tests.commands import BILEVEL
from tests.faults.outcome import Row
from tests.faults.stage import Injector, Stage, StageStudy


def truncated_lines(stage: Stage, times: int) -> Row:
    """Kill the driver and append a part of a line to the journal, as after a machine crash."""
    study = stage.study("torn")
    path = study.folder / "results.json"

    def truncate(_: int) -> bool:
        content = path.read_bytes() if path.exists() else b""
        if not content.endswith(b"\n"):
            return False
        last = content.splitlines()[-1]
        with path.open("ab") as file:
            file.write(last[: stage.chance.randrange(1, len(last))])
        return True

    injected, code = _kill_and_damage(stage, study, times, truncate)
    return stage.row("last journal line cut short", injected, code, study)


def damaged_checkpoints(stage: Stage, times: int) -> Row:
    """Kill the driver, and flip a bit of a checkpoint, empty it, or truncate it."""
    study = stage.study("damaged")

    def damage(number: int) -> bool:
        paths = sorted(study.folder.glob("configurations/*/*/state.safetensors"))
        if not paths:
            return False
        content = bytearray(paths[-1].read_bytes())
        place = stage.chance.randrange(len(content))
        content[place] ^= 1 << stage.chance.randrange(8)
        paths[-1].write_bytes([bytes(content), b"", bytes(content[:place])][number % 3])
        return True

    injected, code = _kill_and_damage(stage, study, times, damage)
    return stage.row("checkpoint damaged (bit, emptied, cut)", injected, code, study)


def _kill_and_damage(
    stage: Stage, study: StageStudy, times: int, damage: Callable[[int], bool]
) -> tuple[int, int]:
    """Kill the driver and damage a file repeatedly, then run the study to the end.

    Return the number of damaged files and the exit code.
    """
    injected, code = 0, -signal.SIGKILL
    journal, results = study.folder / "results.json", len(stage.reference.results)
    while code != 0 and injected < times:
        code = study.run_for(stage.chance.uniform(5.0, 8.0), signal.SIGKILL)
        injected += code != 0 and damage(injected)
        if journal.exists() and journal.read_bytes().count(b"\n") >= results:
            break
    return injected, code and study.run()


def second_process(stage: Stage, times: int) -> Row:
    """Give the same command repeatedly while the study runs; it must be refused."""
    study = stage.study("twice")
    second = replace(study, log=study.log.with_suffix(".2.log"))

    def start_again() -> bool:
        if not study.folder.exists():
            return False
        assert second.run() == 2
        assert "is being run by another process" in second.log.read_text()
        return True

    injector = Injector(stage, start_again, times)
    code = study.run(injector)
    return stage.row("the same study started a second time", injector.injected, code, study)


def full_disk(stage: Stage) -> Row:
    """Fill the disk of the home during the study, then add space.

    The disk is a tmpfs in its own mount namespace, in which a Ray cluster runs.
    """
    uri = f"sqlite:///{stage.folder}/full-disk.db"
    study = stage.study("disk", tracking_uri=uri, own_cluster=True)
    disk, copy = study.home.folder, stage.folder / "copy"
    disk.mkdir()
    command = f"{' '.join([BILEVEL, *study.arguments])} >> {study.log} 2>&1"
    script = f"""
        mount -t tmpfs -o size=100k none {disk} || exit 99
        {command}; first=$?
        mount -o remount,size=100m {disk}
        {command}; second=$?
        cp -r {disk}/. {copy}
        exit $((first * 10 + second))
    """
    unshare = ["unshare", "--map-root-user", "--mount", "bash", "-c", script]
    code = subprocess.run(unshare, timeout=280, check=False).returncode
    if code == 99:
        raise OSError("cannot mount a tmpfs on this machine")
    log = study.log.read_text()
    assert code // 10 == 2, log
    assert "No space left on device" in log
    shutil.copytree(copy, disk, dirs_exist_ok=True)  # where MLflow expects the artifacts
    return stage.row("disk full", 1, code % 10, study)
