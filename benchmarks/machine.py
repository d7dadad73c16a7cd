"""What every result states: machine, versions, commit."""

import json
import os
import platform
import re
import statistics
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks.arguments import format_seeds
from bilevel.durable import write_aside
from cluster.storage.author import commit

RESULTS = Path(__file__).parent / "results"

_PACKAGES = ("bilevel", "numpy", "numba", "torch", "ray", "gymnasium", "hpbandster", "mlflow")

_PLAIN_LIST = re.compile(r"\[[^\[\]{}]*\]")


def machine() -> dict[str, Any]:
    """Processor, cores, Python and package versions."""
    model = platform.processor()
    with suppress(OSError):  # where there is no such file
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **{package: version(package) for package in _PACKAGES},
    }


def spread(values: Sequence[float]) -> dict[str, float]:
    """Median, lowest and highest value, of four significant digits."""
    told = {"median": statistics.median(values), "low": min(values), "high": max(values)}
    return {name: float(f"{value:.4g}") for name, value in told.items()}


def write_result(name: str, command: str, values: dict[str, Any], resumed: bool = False) -> Path:
    """Write `results/NAME.json`, whole or not at all, with lists of plain values on one line; if
    `resumed`, part of it is there already, and the commits that measured it stay named."""
    path = RESULTS / f"{name}.json"
    stated: dict[str, Any] = {"command": command, "commit": commit()}
    if resumed:
        with suppress(NotMeasured):
            before = read_result(name)
            # Results of the first versions name none.
            measured = {*before.get("earlier_commits", ()), before.get("commit", "")}
            earlier = measured - {"", commit()}
            stated |= {"earlier_commits": sorted(earlier)} if earlier else {}
    content = json.dumps({**stated, "machine": machine(), **values}, indent=2)
    content = _PLAIN_LIST.sub(lambda match: " ".join(match[0].split()), content)
    write_aside(path, f"{content}\n".encode())
    return path


class NotMeasured(LookupError):
    """A result has not been measured yet."""


def read_result(name: str, *parts: str) -> dict[str, Any]:
    """Read `results/NAME.json`. Raises NotMeasured if the file or one of `parts` is missing."""
    path = RESULTS / f"{name}.json"
    content: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    if not content or any(part not in content for part in parts):
        raise NotMeasured(f"`benchmarks/results/{name}.json`")
    return content


def resumed_result(name: str, command: str, growing: Sequence[str]) -> dict[str, Any]:
    """What an earlier call of the command has written to `results/NAME.json`, {} if nothing. The
    options `growing` may have had other values. Exits if another command has written it."""
    try:
        before = read_result(name)
    except NotMeasured:
        return {}
    grown = re.compile(rf" --({'|'.join(growing)}) \S+")
    if grown.sub("", before["command"]) != grown.sub("", command):
        raise SystemExit(
            f"benchmarks/results/{name}.json was measured by {before['command']!r}: give its "
            "options, or move it away"
        )
    return before


def resumed_runs(
    name: str, command: str, growing: Sequence[str], seeds: Sequence[int]
) -> list[dict[str, Any]]:
    """The runs of a `resumed_result`. Exits, too, if some have other seeds than `seeds`."""
    runs: list[dict[str, Any]] = resumed_result(name, command, growing).get("runs", [])
    require_seeds(name, {run["seed"] for run in runs}, seeds)
    return runs


def require_as_many(name: str, option: str, measured: int, asked: int) -> None:
    """Exit if a result has more of something than `option` asks for: the command would be told as
    that of all."""
    if measured > asked:
        raise SystemExit(
            f"benchmarks/results/{name}.json was measured with {option} {measured}: give that or "
            "more, or move it away"
        )


def require_seeds(name: str, measured: set[int], seeds: Sequence[int]) -> None:
    """Exit if some of the seeds that a result has are not in `seeds`, those of the command: it
    would be told as the command of all."""
    if lacking := measured.difference(seeds):
        raise SystemExit(
            f"benchmarks/results/{name}.json has the seeds {format_seeds(sorted(lacking))}, too: "
            "add them to --seeds, or move it away"
        )
