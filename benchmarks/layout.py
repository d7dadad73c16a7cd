"""Rooms, imports and lines of the packages, now and before their redesign.

    python -m benchmarks.layout

*Rooms* are the files and folders directly in a package, *arrows* the imports between them, and
*back up* the fewest arrows without which they would point in one direction.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import grimp

from benchmarks.machine import read_result, spread, write_result
from benchmarks.markdown import source, table

ROOT = Path(__file__).parent.parent
#: The last commit before the redesign.
BEFORE = "08f9bbe"
REPEATS = 7


def rooms(package: str) -> dict[str, int]:
    """Rooms and arrows of an importable package."""
    graph = grimp.build_graph(package, cache_dir=None)
    children = sorted(graph.find_children(package))
    for child in children:
        graph.squash_module(child)
    arrows = {
        (one, other)
        for one in children
        for other in graph.find_modules_directly_imported_by(one)
        if other in children
    }
    back = graph.nominate_cycle_breakers(package)
    return {"rooms": len(children), "arrows": len(arrows), "back up": len(back)}


def counted(folder: Path) -> dict[str, Any]:
    """The figures of the packages in a folder; another process looks at them, since this one has
    imported its own."""
    lines = sum(len(path.read_text().splitlines()) for path in folder.rglob("*.py"))
    shutil.rmtree(folder / "benchmarks")  # of that tree; these are of this one
    script = (
        "import json; from benchmarks.layout import rooms; "
        "print(json.dumps({name: rooms(name) for name in ('bilevel', 'cluster')}))"
    )
    command = [sys.executable, "-P", "-c", script]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return {**json.loads(found.stdout), "lines": lines}


def archived(commit: str, folder: Path) -> Path:
    """The tree of a commit, written to a folder."""
    tree = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True)
    subprocess.run(["tar", "-x"], cwd=folder, input=tree.stdout, check=True)
    return folder


def import_seconds() -> list[float]:
    """Seconds that `import bilevel` adds to a process that imports nothing."""
    seconds = []
    for _ in range(REPEATS):
        times = []
        for code in ("pass", "import bilevel"):
            began = time.perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True)
            times.append(time.perf_counter() - began)
        seconds.append(times[1] - times[0])
    return seconds


def layout() -> str:
    """The table of CONTRIBUTING.md."""
    result = read_result("layout")
    before, now = result["before"], result["now"]
    rows = [
        [
            what,
            *(tree[package][what] for package in ("bilevel", "cluster") for tree in (before, now)),
        ]
        for what in ("rooms", "arrows", "back up")
    ]
    seconds = result["import_seconds"]
    head = ["", "`bilevel` before", "`bilevel` now", "`cluster` before", "`cluster` now"]
    return (
        f"{table(head, rows)}\n\n"
        f"All Python files together had {before['lines']} lines before and have {now['lines']} "
        f"now. `import bilevel` takes {seconds['median']:.2f} s ({seconds['low']:.2f} to "
        f"{seconds['high']:.2f}).\n{source(result)}"
    )


def main() -> None:
    """Measure and write the result."""
    with tempfile.TemporaryDirectory() as old, tempfile.TemporaryDirectory() as new:
        found = {
            "before": counted(archived(BEFORE, Path(old))),
            "now": counted(archived("HEAD", Path(new))),
        }
    command = "python -m benchmarks.layout"
    write_result("layout", command, {**found, "import_seconds": spread(import_seconds())})
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
