"""The faults of `python -m benchmarks.faults`, and how often each is injected."""

from collections.abc import Callable
from functools import partial

from tests.faults import disks, processes, tracking
from tests.faults.outcome import Row
from tests.faults.stage import ACTOR, TRIAL, Stage

#: All faults by their names on the command line.
FAULTS: dict[str, Callable[[Stage], Row]] = {
    "driver": partial(processes.driver, times=20),
    "driver-of-two": partial(processes.driver_of_two_trials, times=5),
    "everything": partial(processes.driver_and_cluster, times=3),
    "own-raylet": partial(processes.own_raylet, times=2),
    "ctrl-c": partial(processes.ctrl_c, times=4, presses=1),
    "ctrl-c-twice": partial(processes.ctrl_c, times=3, presses=2),
    "actor": partial(processes.killed_children, times=5, titles=ACTOR, name="actor of the pool"),
    "trial": partial(processes.killed_children, times=4, titles=TRIAL, name="trial"),
    "nodes": partial(processes.nodes, times=3),
    "server": partial(tracking.server_killed, times=3),
    "locked": partial(tracking.database_locked, times=2),
    "full-disk": disks.full_disk,
    "torn": partial(disks.truncated_lines, times=4),
    "damaged": partial(disks.damaged_checkpoints, times=3),
    "twice": partial(disks.second_process, times=3),
}
