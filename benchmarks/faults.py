"""Inject faults into studies repeatedly, and write `results/faults.json`, in about 20 minutes.

python -m benchmarks.faults [--folder FOLDER] [FAULT ...]

Named faults replace only their own rows.
"""

import argparse
import signal
import tempfile
import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from benchmarks.machine import NotMeasured, read_result, write_result
from benchmarks.markdown import table


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
    from tests.faults.scenarios import FAULTS  # not at the top: the table needs no Ray
    from tests.faults.stage import Stage

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
