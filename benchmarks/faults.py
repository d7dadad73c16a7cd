"""Inject faults into studies repeatedly, and write `results/faults.json`, in about 20 minutes.

python -m benchmarks.faults [--folder FOLDER] [FAULT ...]

Named faults replace only their own rows.
"""

import argparse
import signal
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path

from benchmarks.machine import NotMeasured, read_result, write_result
from benchmarks.markdown import table
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


def faults() -> str:
    """Return the table of docs/reliability.md."""
    result = read_result("faults")
    head = "fault", "injected", "results", "lost", "twice", "identical", "MLflow as on disk"
    rows = [
        (
            row["fault"] + (f" (exit code {row['exit_code']})" if row["exit_code"] else ""),
            *(row[name] for name in ("injected", "results", "lost", "duplicated")),
            "yes" if row["identical"] else "no",
            "no" if row["mlflow"] else "yes",
        )
        for row in result["rows"].values()
    ]
    return table(head, rows, result)


def main() -> None:
    """Inject the named faults, or all."""
    # Studies inherit ignored signals: scripts run background processes with SIGINT ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="of studies and logs; default: temporary")
    parser.add_argument("fault", nargs="*", help=", ".join(FAULTS))
    arguments = parser.parse_args()
    if unknown := set(arguments.fault) - FAULTS.keys():
        parser.error(f"unknown faults {sorted(unknown)}: allowed are {', '.join(FAULTS)}")
    with (
        tempfile.TemporaryDirectory() as temporary,
        Stage(arguments.folder or Path(temporary)) as stage,
    ):
        for name in arguments.fault or FAULTS:
            started = time.monotonic()
            row = FAULTS[name](stage)
            print(f"{name}: {row}, {time.monotonic() - started:.0f} s", flush=True)
            rows = {name: asdict(row)}
            with suppress(NotMeasured):
                rows = read_result("faults")["rows"] | rows
            ordered = {known: rows[known] for known in FAULTS if known in rows}
            write_result("faults", "python -m benchmarks.faults", {"rows": ordered})


if __name__ == "__main__":
    main()
