"""Result files with machine, versions and commit, and command line arguments of benchmarks."""

import argparse
import json
import os
import platform
import re
import statistics
from collections.abc import Sequence
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput
from bilevel.tasks import get_task
from cluster.storage.author import commit

RESULTS = Path(__file__).parent / "results"

_PACKAGES = ("bilevel", "numpy", "numba", "torch", "ray", "gymnasium", "hpbandster", "mlflow")

#: The innermost lists and dictionaries of a JSON file, which are written on one line.
_INNERMOST = re.compile(r"[\[{][^\[\]{}]*[\]}]")


class NotMeasured(LookupError):
    """A result has not been measured yet."""


def known_task(text: str) -> str:
    """Return the id of a task. Raises ArgumentTypeError for an unknown task."""
    try:
        return get_task(text).id
    except InvalidInput as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def parse_seeds(text: str) -> list[int]:
    """Parse a list of seeds and ranges, such as "0-4,9". Raises ArgumentTypeError."""
    seeds: list[int] = []
    for part in text.split(","):
        if not re.fullmatch(r"\d+(-\d+)?", part):
            raise argparse.ArgumentTypeError(f"seeds are a list such as 0-4,9; got {text!r}")
        first, *last = map(int, part.split("-"))
        seeds += range(first, max([first, *last]) + 1)
    return seeds


def format_seeds(seeds: Sequence[int]) -> str:
    """Return the list in the format of `parse_seeds`, with consecutive seeds as ranges."""
    starts = [0, *(i for i, (a, b) in enumerate(pairwise(seeds), 1) if b != a + 1), len(seeds)]
    runs = [(seeds[a], seeds[b - 1]) for a, b in pairwise(starts) if a < b]
    return ",".join(f"{a}-{b}" if b > a else str(a) for a, b in runs)


def machine() -> dict[str, Any]:
    """Return processor, cores, Python and package versions."""
    model, cpuinfo = platform.processor(), Path("/proc/cpuinfo")
    if cpuinfo.exists():
        found = re.search(r"^model name\s*: (.*)$", cpuinfo.read_text(), re.MULTILINE)
        model = found[1].strip() if found else model
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **{package: version(package) for package in _PACKAGES},
    }


def spread(values: Sequence[float]) -> dict[str, float]:
    """Return median, minimum and maximum with four significant digits."""
    summary = {"median": statistics.median(values), "low": min(values), "high": max(values)}
    return {name: float(f"{value:.4g}") for name, value in summary.items()}


def write_result(name: str, command: str, values: dict[str, Any], resumed: bool = False) -> Path:
    """Write `results/NAME.json` atomically; `resumed` keeps the commits of earlier parts."""
    path = RESULTS / f"{name}.json"
    header: dict[str, Any] = {"command": command, "commit": commit()}
    if resumed and path.exists():
        before = json.loads(path.read_text())
        commits = {*before.get("earlier_commits", ()), before.get("commit", "")} - {"", commit()}
        header |= {"earlier_commits": sorted(commits)} if commits else {}
    content = json.dumps({**header, "machine": machine(), **values}, indent=1)
    content = _INNERMOST.sub(lambda match: " ".join(match[0].split()), content)
    write_aside(path, f"{content}\n".encode())
    print(f"written to {path}", flush=True)
    return path


def read_result(name: str, *parts: str) -> dict[str, Any]:
    """Read `results/NAME.json`. Raises NotMeasured if the file or one of `parts` is missing."""
    path = RESULTS / f"{name}.json"
    content: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    if not content or any(part not in content for part in parts):
        raise NotMeasured(f"`benchmarks/results/{name}.json`")
    return content


def earlier_result(name: str, command: str, growing: Sequence[str]) -> dict[str, Any]:
    """Return `results/NAME.json` to extend it, or {} if it does not exist.

    Only the options `growing` may differ from `command`. Exits if others do.
    """
    try:
        before = read_result(name)
    except NotMeasured:
        return {}
    values = re.compile(rf" --({'|'.join(growing)}) \S+")
    if values.sub("", before["command"]) != values.sub("", command):
        raise SystemExit(
            f"benchmarks/results/{name}.json was measured by {before['command']!r}: use its "
            "options, or move the file away"
        )
    return before
