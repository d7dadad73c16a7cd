"""Faults of processes and nodes: killed drivers, trials, actors, raylets."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus
from tests.commands import run_bilevel
from tests.ends import kill
from tests.faults.outcome import Outcome
from tests.faults.row import Row
from tests.faults.stage import ACTOR, BRACKETS, ONE_BY_ONE, STUDY, TASK, Stage, StudyOnStage, smoke
from tests.mlflow_shown import Server, disagreements

#: Seconds after which the driver is stopped at the latest.
LATEST = 9.0


def driver(stage: Stage, whole: Outcome, kills: int, latest: float = LATEST) -> Row:
    """SIGKILL the driver of one study at random moments; then let the study end."""
    study = stage.study("driver", *ONE_BY_ONE)
    killed, code = _stopped_again_and_again(stage, study, kills, (0.5, latest), signal.SIGKILL)
    return Row.of("driver killed (SIGKILL), one study", killed, code, whole, study)


def driver_of_two(stage: Stage, whole: Outcome, kills: int) -> Row:
    """SIGKILL the driver of a study with two trials at a time."""
    node = stage.cluster.add_node(num_cpus=1)
    with Server(stage.folder / "two-server") as server:
        study = stage.study("two", "--concurrent-trials", "2", tracking_uri=server.uri)
        killed, code = _stopped_again_and_again(stage, study, kills, (0.5, LATEST), signal.SIGKILL)
        name = "driver killed (SIGKILL), two trials at a time"
        wrong, outcome = study.disagreements(), study.outcome().in_any_order()
    stage.cluster.remove_node(node)
    return Row.compare(name, killed, code, whole.in_any_order(), outcome, wrong)


def ctrl_c(stage: Stage, whole: Outcome, times: int, presses: int) -> Row:
    """Press Ctrl-C once, for a clean stop, or twice, which stops at once."""
    study = stage.study(f"ctrl-c-{presses}", *ONE_BY_ONE)
    signals = [signal.SIGINT] * presses
    stopped, code = _stopped_again_and_again(stage, study, times, (3.0, LATEST), *signals)
    return Row.of("Ctrl-C" if presses == 1 else "Ctrl-C twice", stopped, code, whole, study)


def _stopped_again_and_again(
    stage: Stage, study: StudyOnStage, times: int, seconds: tuple[float, float], *signals: int
) -> tuple[int, int]:
    """Give the command repeatedly, signal it at a random moment between these seconds, and let it
    end at last; return how many signals arrived before the study's end, and the last exit code.
    (Another command after the end would add brackets.)"""
    for stopped in range(times):
        code = study.live(stage.chance.uniform(*seconds), *signals)
        assert code in (0, -signals[0], 130), f"exit code {code}: see {study.log}"
        if code == 0:
            return stopped, code
        run_status = RunStatus.load(study.folder)  # None if it had not come so far
        if signals == (signal.SIGINT,) and run_status is not None:
            assert run_status.status != "RUNNING", f"left running: see {study.log}"
        if run_status is not None and run_status.status == "FINISHED":  # MLflow may lag behind
            place = ("--home", study.home.folder, "--tracking-uri", study.tracking_uri)
            assert run_bilevel("sync", study.folder.name, *place).returncode == 0
            return stopped + 1, 0
    return times, study.run()


def killed_children(
    stage: Stage, whole: Outcome, titles: tuple[str, ...], what: str, times: int
) -> Row:
    """SIGKILL processes of a study, one every second or two."""
    study = stage.study(what.split()[0], *ONE_BY_ONE)
    killed: list[int] = []
    pause = [time.monotonic() + 3.0]

    def kill_one() -> None:
        if len(killed) >= times or time.monotonic() < pause[0]:
            return
        for process in stage.processes(*titles)[:1]:
            kill(process)
            killed.append(process.pid)
            pause[0] = time.monotonic() + stage.chance.uniform(1.0, 2.5)

    code = study.run(kill_one)
    return Row.of(f"{what} killed (SIGKILL)", len(killed), code, whole, study)


def nodes(
    folder: Path,
    whole: Outcome,
    times: int,
    brackets: int = BRACKETS,
    database: Path | None = None,
) -> Row:
    """SIGKILL the raylet of the node that does all the work (the head has no core), while
    another joins. `database` is one of MLflow's without a run, if there is one."""
    with (
        Stage(folder / "nodes", cores=0, brackets=brackets) as stage,
        Server(folder / "nodes-server", empty=database) as server,
    ):
        study = stage.study("nodes", *ONE_BY_ONE, tracking_uri=server.uri)
        working = [stage.cluster.add_node(num_cpus=1)]
        left = [0]
        pause = [time.monotonic() + 4.0]

        def move() -> None:
            if left[0] >= times or time.monotonic() < pause[0] or not stage.processes(*ACTOR):
                return
            working.append(stage.cluster.add_node(num_cpus=1))
            stage.cluster.remove_node(working.pop(0), allow_graceful=False)
            left[0] += 1
            pause[0] = time.monotonic() + stage.chance.uniform(4.0, 7.0)

        code, name = study.run(move), "raylet of a node killed (SIGKILL), another joins"
        return Row.of(name, left[0], code, whole, study)


def everything(folder: Path, whole: Outcome, times: int, moment: Callable[[], float]) -> Row:
    """SIGKILL the console script together with the Ray cluster that it started."""
    what = "driver killed with its own Ray cluster (SIGKILL)"
    return _alone(folder / "everything", what, whole, times, moment, _kill_everything)


def own_raylet(folder: Path, whole: Outcome, times: int, moment: Callable[[], float]) -> Row:
    """SIGKILL the raylet that a driver is connected to, which also ends the driver."""
    what = "the driver's own raylet killed (SIGKILL)"
    return _alone(folder / "own-raylet", what, whole, times, moment, _kill_raylet)


def _alone(
    folder: Path,
    fault: str,
    whole: Outcome,
    times: int,
    moment: Callable[[], float],
    kill: Callable[[psutil.Process], None],
) -> Row:
    """Kill and repeat the console script with its own Ray cluster."""
    folder.mkdir()
    home = Home(folder / "home")
    command = [str(Path(sys.executable).with_name("bilevel")), "bohb", TASK, *smoke(), *ONE_BY_ONE]
    command += ["--home", str(home.folder)]
    with (folder / "log").open("a") as log:
        killed, code = 0, None
        for _ in range(times):
            process = psutil.Popen(command, stdout=log, stderr=log, start_new_session=True)
            try:
                code = process.wait(moment())
                break  # the same command would add brackets to a study that has ended
            except psutil.TimeoutExpired:
                family = [process, *process.children(recursive=True)]
                kill(process)
                psutil.wait_procs(family, 60)
                killed += 1
        if code is None:
            ended = subprocess.run(command, stdout=log, stderr=log, timeout=240, check=False)
            code = ended.returncode
    study = home.run_folder(TASK, STUDY)
    wrong = disagreements(study, home.database_uri)
    return Row.compare(fault, killed, code, whole, Outcome.of(study), wrong)


def _kill_everything(driver: psutil.Process) -> None:
    os.killpg(driver.pid, signal.SIGKILL)


def _kill_raylet(driver: psutil.Process) -> None:
    for child in driver.children():
        if Path(child.exe()).name == "raylet":
            kill(child)
