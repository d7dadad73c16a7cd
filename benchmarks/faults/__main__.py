"""Injects every fault and writes `results/faults.json`, in about twenty minutes.

python -m benchmarks.faults [--folder FOLDER] [FAULT ...]

Named faults replace only their own rows.
"""

import argparse
import json
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from benchmarks.machine import RESULTS, write_result
from tests.faults import disks, processes, tracking
from tests.faults.row import Row
from tests.faults.stage import ACTOR, ONE_BY_ONE, TRIAL, Stage

Fault = Callable[[], Row]


def faults(stage: Stage, folder: Path) -> dict[str, Fault]:
    """All faults, by their names on the command line."""
    study = stage.study("whole", *ONE_BY_ONE)
    if study.run() != 0:
        raise RuntimeError(f"the undisturbed study fails: see {study.log}")
    whole = study.outcome()

    return {
        "driver": lambda: processes.driver(stage, whole, 20),
        "driver-of-two": lambda: processes.driver_of_two(stage, whole, 5),
        "everything": lambda: processes.everything(
            folder, whole, 3, lambda: stage.chance.uniform(8.0, 16.0)
        ),
        "own-raylet": lambda: processes.own_raylet(
            folder, whole, 2, lambda: stage.chance.uniform(12.0, 16.0)
        ),
        "ctrl-c": lambda: processes.ctrl_c(stage, whole, 4, presses=1),
        "ctrl-c-twice": lambda: processes.ctrl_c(stage, whole, 3, presses=2),
        "actor": lambda: processes.killed_children(stage, whole, ACTOR, "actor of the pool", 5),
        "trial": lambda: processes.killed_children(stage, whole, TRIAL, "trial", 4),
        "nodes": lambda: processes.nodes(folder, whole, 3),
        "server": lambda: tracking.server_killed(stage, whole, 3),
        "locked": lambda: tracking.database_locked(stage, whole, 2),
        "full-disk": lambda: disks.full_disk(folder, whole),
        "torn": lambda: disks.torn_lines(stage, whole, 4),
        "damaged": lambda: disks.damaged_checkpoints(stage, whole, 3),
        "twice": lambda: disks.two_processes(stage, whole, 3),
    }


def main() -> None:
    """Inject the named faults, or all."""
    # Studies inherit what is ignored, as SIGINT is where a script runs this in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--folder", type=Path, help="folder of studies and logs (default: a temporary one)"
    )
    parser.add_argument("fault", nargs="*")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        with Stage(folder) as stage:
            known = faults(stage, folder)
            for name in arguments.fault or known:
                begun = time.monotonic()
                row = known[name]()
                print(f"{name}: {row}, {time.monotonic() - begun:.0f} s", flush=True)
                _write(name, row, list(known))


def _write(name: str, row: Row, order: list[str]) -> None:
    path = RESULTS / "faults.json"
    rows = json.loads(path.read_text())["rows"] if path.exists() else {}
    rows[name] = asdict(row)
    rows = {known: rows[known] for known in order if known in rows}
    write_result("faults", "python -m benchmarks.faults", {"rows": rows})


if __name__ == "__main__":
    main()
