"""Faults of disks and files: a full disk, a torn line, a damaged checkpoint, a locked folder."""

import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from cluster.storage.home import Home
from tests.faults.outcome import Outcome
from tests.faults.row import Row
from tests.faults.stage import ONE_BY_ONE, STUDY, TASK, Stage, StudyOnStage, smoke
from tests.mlflow_shown import disagreements


def torn_lines(stage: Stage, whole: Outcome, times: int) -> Row:
    """Kill the driver and append a part of a line to the journal, as a machine crash can leave of
    an unflushed write; until so many lines are torn, or all results are there."""
    study, torn = stage.study("torn", *ONE_BY_ONE), 0
    journal = study.folder / "results.json"
    code = -signal.SIGKILL
    while code != 0 and torn < times:
        code = study.live(stage.chance.uniform(5.0, 8.0), signal.SIGKILL)
        torn += _tear(journal, stage.chance.uniform)
        if journal.exists() and journal.read_bytes().count(b"\n") >= len(whole.results):
            break
    code = code and study.run()
    return Row.of("last journal line cut short", torn, code, whole, study)


def _tear(path: Path, uniform: Callable[[float, float], float]) -> int:
    content = path.read_bytes() if path.exists() else b""
    if not content.endswith(b"\n"):
        return 0
    last = content.splitlines()[-1]
    with path.open("ab") as file:
        file.write(last[: int(uniform(1, len(last)))])
    return 1


def damaged_checkpoints(stage: Stage, whole: Outcome, times: int) -> Row:
    """Kill the driver, and flip a bit, empty, or cut short a checkpoint; as long as the study has
    not ended."""
    study, done = stage.study("damaged", *ONE_BY_ONE), 0
    code = -signal.SIGKILL
    while code != 0 and done < times:
        code = study.live(stage.chance.uniform(5.0, 8.0), signal.SIGKILL)
        for path in sorted(study.folder.glob("configurations/*/*/state.safetensors"))[-1:]:
            content = bytearray(path.read_bytes())
            place = stage.chance.randrange(len(content))
            content[place] ^= 1 << stage.chance.randrange(8)
            path.write_bytes([bytes(content), b"", bytes(content[:place])][done % 3])
            done += 1
    code = code and study.run()
    return Row.of("checkpoint damaged (bit, emptied, cut)", done, code, whole, study)


def two_processes(stage: Stage, whole: Outcome, times: int) -> Row:
    """Give the same command repeatedly while the study runs; all but the first are refused."""
    study = stage.study("twice", *ONE_BY_ONE)
    refused = [0]

    def again() -> None:
        if refused[0] < times and study.folder.exists():
            second = StudyOnStage(
                study.home, study.tracking_uri, study.arguments, study.log.with_suffix(".2.log")
            )
            assert second.run() == 2
            assert "is being run by another process" in second.log.read_text()
            refused[0] += 1

    code = study.run(again)
    return Row.of("the same study started a second time", refused[0], code, whole, study)


def full_disk(folder: Path, whole: Outcome) -> Row:
    """Fill the disk of the home during the study, then make room again.

    The disk is a tmpfs in its own mount namespace, in which a Ray cluster runs.
    """
    disk, kept = folder / "disk", folder / "kept"
    disk.mkdir()
    log = folder / "full-disk.log"
    bilevel = Path(sys.executable).with_name("bilevel")
    command = " ".join(map(str, (bilevel, "bohb", TASK, *smoke(), *ONE_BY_ONE, "--home", disk)))
    uri = f"sqlite:///{folder}/full-disk.db"
    script = f"""
        mount -t tmpfs -o size=100k none {disk} || exit 99
        {command} --tracking-uri {uri} >> {log} 2>&1; first=$?
        mount -o remount,size=100m {disk}
        {command} --tracking-uri {uri} >> {log} 2>&1; second=$?
        cp -r {disk}/. {kept}
        exit $((first * 10 + second))
    """
    unshare = ["unshare", "--map-root-user", "--mount", "bash", "-c", script]
    code = subprocess.run(unshare, timeout=280, check=False).returncode
    if code == 99:
        raise OSError("no disk can be mounted here")
    assert code // 10 == 2, log.read_text()
    assert "No space left on device" in log.read_text()
    shutil.copytree(kept, disk, dirs_exist_ok=True)  # MLflow expects the artifacts there
    study = Home(disk).run_folder(TASK, STUDY)
    wrong = disagreements(study, uri)
    return Row.compare("disk full", 1, code % 10, whole, Outcome.of(study), wrong)
