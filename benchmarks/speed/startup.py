"""Seconds of each part of the start of `bilevel nes CartPole-v0`, up to its first evaluation.

    python -m benchmarks.speed.startup

`benchmarks.speed.watched_command` runs the command and reports when each part ends.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.machine import read_result, spread, write_result
from benchmarks.markdown import format_spread, table
from benchmarks.speed.watched_command import PARTS

REPEATS = 3


def start(home: Path) -> dict[str, float]:
    """Return the seconds of each part of one start, and their sum."""
    command = [sys.executable, "-m", "benchmarks.speed.watched_command", str(time.time())]
    command += ["nes", "CartPole-v0", "--home", str(home)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    times = dict(json.loads(line) for line in done.stdout.splitlines() if line.startswith('["'))
    ends = [times[part] for part in PARTS]
    return {**dict(zip(PARTS, np.diff([0.0, *ends]).tolist(), strict=True)), "all": ends[-1]}


def starts(fresh: bool) -> dict[str, dict[str, float]]:
    """Return statistics of `REPEATS` starts, each in a fresh home or all in one used home."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for i in range(REPEATS + (not fresh)):
            rows.append(start(Path(folder) / (str(i) if fresh else "home")))
            print(rows[-1], flush=True)
    return {part: spread([row[part] for row in rows[-REPEATS:]]) for part in rows[0]}


def startup() -> str:
    """Return the table."""
    result = read_result("startup")
    rows = [
        (home, *(format_spread(parts[name], ".1f") for name in (*result["parts"], "all")))
        for home, parts in result["seconds"].items()
    ]
    return table(("seconds", *result["parts"], "all"), rows, result)


def main() -> None:
    """Measure and write `results/startup.json`."""
    seconds = {"first time": starts(fresh=True), "again": starts(fresh=False)}
    values = {"repeats": REPEATS, "parts": list(PARTS), "seconds": seconds}
    write_result("startup", "python -m benchmarks.speed.startup", values)


if __name__ == "__main__":
    main()
