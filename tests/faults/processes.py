"""Faults of processes and nodes: killed drivers, trials, actors, raylets."""

import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import psutil

from cluster.storage.run_folder import RunStatus
from tests.commands import BILEVEL, run_bilevel
from tests.ends import kill
from tests.faults.outcome import Row
from tests.faults.stage import ACTOR, Injector, Stage, StageStudy
from tests.mlflow_shown import Server

#: Seconds after which a driver is stopped at the latest.
LATEST = 9.0


def driver(stage: Stage, times: int, latest: float = LATEST) -> Row:
    """Kill the driver of one study at random moments."""
    study = stage.study("driver")
    killed, code = interrupt(stage, study, times, (0.5, latest), signal.SIGKILL)
    return stage.row("driver killed (SIGKILL), one study", killed, code, study)


def driver_of_two_trials(stage: Stage, times: int) -> Row:
    """Kill the driver of a study with two trials at a time."""
    node = stage.cluster.add_node(num_cpus=1)
    with Server(stage.folder / "two-server") as server:
        study = stage.study("two", "--concurrent-trials", "2", tracking_uri=server.uri)
        killed, code = interrupt(stage, study, times, (0.5, LATEST), signal.SIGKILL)
        title = "driver killed (SIGKILL), two trials at a time"
        row = stage.row(title, killed, code, study, ordered=False)
    stage.cluster.remove_node(node)
    return row


def ctrl_c(stage: Stage, times: int, presses: int) -> Row:
    """Press Ctrl-C once, for a clean stop, or twice, to stop immediately."""
    study = stage.study(f"ctrl-c-{presses}")
    signals = [signal.SIGINT] * presses
    stopped, code = interrupt(stage, study, times, (3.0, LATEST), *signals)
    return stage.row("Ctrl-C" if presses == 1 else "Ctrl-C twice", stopped, code, study)


def interrupt(
    stage: Stage, study: StageStudy, times: int, seconds: tuple[float, float], *signals: int
) -> tuple[int, int]:
    """Start the study repeatedly and signal it at random moments, then run it to the end.

    Return the number of signals before the study's end, and the last exit code. A finished study
    is not started again, because that would add brackets.
    """
    for stopped in range(times):
        code = study.run_for(stage.chance.uniform(*seconds), *signals)
        assert code in (0, -signals[0], 130), f"exit code {code}: see {study.log}"
        if code == 0:
            return stopped, code
        run_status = RunStatus.load(study.folder)
        if run_status is None:  # stopped before the study was created
            continue
        if signals == (signal.SIGINT,):
            assert run_status.status != "RUNNING", f"left running: see {study.log}"
        if run_status.status == "FINISHED":  # before MLflow was updated
            place = ("--home", study.home.folder, "--tracking-uri", study.tracking_uri)
            assert run_bilevel("sync", study.folder.name, *place).returncode == 0
            return stopped + 1, 0
    return times, study.run()


def killed_children(stage: Stage, times: int, titles: tuple[str, ...], name: str) -> Row:
    """Kill processes of a study, one every second or two."""
    study = stage.study(name.split()[0])

    def kill_first() -> bool:
        found = stage.processes(titles)[:1]
        for process in found:
            kill(process)
        return bool(found)

    injector = Injector(stage, kill_first, times, delay=3.0, pause=(1.0, 2.5))
    code = study.run(injector)
    return stage.row(f"{name} killed (SIGKILL)", injector.injected, code, study)


def nodes(stage: Stage, times: int, database: Path | None = None) -> Row:
    """Kill the raylet of the only working node while another node joins.

    `database` is an empty MLflow database to copy, which takes less time than creating one.
    """
    folder = stage.folder
    with (
        Stage(folder / "nodes", cores=0, brackets=stage.brackets) as other,
        Server(folder / "nodes-server", empty=database) as server,
    ):
        study = other.study("nodes", tracking_uri=server.uri)
        working = [other.cluster.add_node(num_cpus=1)]

        def replace_node() -> bool:
            if not other.processes(ACTOR):
                return False
            working.append(other.cluster.add_node(num_cpus=1))
            other.cluster.remove_node(working.pop(0), allow_graceful=False)
            return True

        injector = Injector(stage, replace_node, times, delay=4.0, pause=(4.0, 7.0))
        code, title = study.run(injector), "raylet of a node killed (SIGKILL), another joins"
        return stage.row(title, injector.injected, code, study)


def driver_and_cluster(stage: Stage, times: int) -> Row:
    """Kill the console script together with the Ray cluster that it started."""

    def kill_all(driver: psutil.Process) -> None:
        os.killpg(driver.pid, signal.SIGKILL)

    title = "driver killed with its own Ray cluster (SIGKILL)"
    return _kill_console_script(stage, "everything", title, times, (8.0, 16.0), kill_all)


def own_raylet(stage: Stage, times: int) -> Row:
    """Kill the raylet that a driver is connected to, which also ends the driver."""

    def kill_raylet(driver: psutil.Process) -> None:
        for child in driver.children():
            if Path(child.exe()).name == "raylet":
                kill(child)

    title = "the driver's own raylet killed (SIGKILL)"
    return _kill_console_script(stage, "own-raylet", title, times, (12.0, 16.0), kill_raylet)


def _kill_console_script(
    stage: Stage,
    name: str,
    title: str,
    times: int,
    seconds: tuple[float, float],
    kill_processes: Callable[[psutil.Process], None],
) -> Row:
    """Start the console script with its own Ray cluster repeatedly, and kill it."""
    study = stage.study(name, own_cluster=True)
    command = [BILEVEL, *study.arguments]
    killed, code = 0, None
    with study.log.open("a") as log:
        while code is None and killed < times:
            process = psutil.Popen(command, stdout=log, stderr=log, start_new_session=True)
            try:
                code = process.wait(stage.chance.uniform(*seconds))
            except psutil.TimeoutExpired:
                family = [process, *process.children(recursive=True)]
                kill_processes(process)
                psutil.wait_procs(family, 60)
                killed += 1
        if code is None:
            code = subprocess.run(command, stdout=log, stderr=log, timeout=240).returncode
    return stage.row(title, killed, code, study)
