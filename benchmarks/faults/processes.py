"""Faults of processes and nodes: killed drivers, trials, actors, raylets."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from benchmarks.faults.outcome import Outcome, disagreements
from benchmarks.faults.row import Row
from benchmarks.faults.stage import ACTOR, ONE_BY_ONE, SMOKE, STUDY, TASK, Stage
from cluster.home import Home


def driver(stage: Stage, whole: Outcome, kills: int) -> Row:
    """SIGKILL the driver of one study at random moments, from its first second on; then
    let it end."""
    study = stage.study("driver", *ONE_BY_ONE)
    for _ in range(kills):
        study.live(stage.chance.uniform(0.5, 9.0), signal.SIGKILL)
    code = study.run()
    return Row.of("driver killed (SIGKILL), one study", kills, code, whole, study)


def ctrl_c(stage: Stage, whole: Outcome, times: int, presses: int) -> Row:
    """Ctrl-C once, the orderly stop, or twice, which stops at once."""
    study = stage.study(f"ctrl-c-{presses}", *ONE_BY_ONE)
    for _ in range(times):
        study.live(stage.chance.uniform(3.0, 10.0), *[signal.SIGINT] * presses)
    code = study.run()
    return Row.of("Ctrl-C" if presses == 1 else "Ctrl-C twice", times, code, whole, study)


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
            process.kill()
            killed.append(process.pid)
            pause[0] = time.monotonic() + stage.chance.uniform(1.0, 2.5)

    code = study.run(kill_one)
    return Row.of(f"{what} killed (SIGKILL)", len(killed), code, whole, study)


def nodes(stage: Stage, whole: Outcome, tracking_uri: str, times: int) -> Row:
    """SIGKILL the raylet of the node that does the work, while another joins."""
    study = stage.study("nodes", *ONE_BY_ONE, tracking_uri=tracking_uri)
    working = [stage.cluster.add_node(num_cpus=1)]
    left = [0]
    pause = [time.monotonic() + 8.0]

    def move() -> None:
        if left[0] >= times or time.monotonic() < pause[0] or not stage.processes(*ACTOR):
            return
        working.append(stage.cluster.add_node(num_cpus=1))
        stage.cluster.remove_node(working.pop(0), allow_graceful=False)
        left[0] += 1
        pause[0] = time.monotonic() + stage.chance.uniform(4.0, 7.0)

    code = study.run(move)
    stage.cluster.remove_node(working.pop())
    return Row.of("raylet of a node killed (SIGKILL), another joins", left[0], code, whole, study)


def everything(folder: Path, whole: Outcome, times: int, moment: Callable[[], float]) -> Row:
    """SIGKILL the console script with the Ray cluster it has started, all at once."""
    what = "driver killed with its own Ray cluster (SIGKILL)"
    return _alone(folder / "everything", what, whole, times, moment, _kill_everything)


def own_raylet(folder: Path, whole: Outcome, times: int, moment: Callable[[], float]) -> Row:
    """SIGKILL the raylet that a driver is connected to: Ray ends the driver, too."""
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
    """The console script with a Ray cluster of its own, killed and given again."""
    folder.mkdir()
    home = Home(folder / "home")
    command = [str(Path(sys.executable).with_name("bilevel")), "bohb", TASK, *SMOKE, *ONE_BY_ONE]
    command += ["--home", str(home.folder)]
    with (folder / "log").open("a") as log:
        for _ in range(times):
            process = psutil.Popen(command, stdout=log, stderr=log, start_new_session=True)
            try:
                process.wait(moment())
            except psutil.TimeoutExpired:
                family = [process, *process.children(recursive=True)]
                kill(process)
                psutil.wait_procs(family, 60)
        code = subprocess.run(command, stdout=log, stderr=log, timeout=240, check=False).returncode
    study = home.run_folder(TASK, STUDY)
    wrong = disagreements(study, home.database_uri)
    return Row.compare(fault, times, code, whole, Outcome.of(study), wrong)


def _kill_everything(driver: psutil.Process) -> None:
    os.killpg(driver.pid, signal.SIGKILL)


def _kill_raylet(driver: psutil.Process) -> None:
    for child in driver.children():
        if Path(child.exe()).name == "raylet":
            child.kill()
