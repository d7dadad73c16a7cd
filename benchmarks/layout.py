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
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

import grimp

from benchmarks.machine import NotMeasured, read_result, spread, write_result
from benchmarks.markdown import source, table

ROOT = Path(__file__).parent.parent
#: The last commit before the redesign.
BEFORE = "08f9bbe"
REPEATS = 7


def rooms(package: str) -> dict[str, Any]:
    """Rooms and arrows of an importable package."""
    graph = grimp.build_graph(package, cache_dir=None)
    children = sorted(graph.find_children(package))
    for child in children:
        graph.squash_module(child)
    drawing = {
        child.rpartition(".")[2]: sorted(
            other.rpartition(".")[2]
            for other in graph.find_modules_directly_imported_by(child)
            if other in children and other != child
        )
        for child in children
    }
    back = graph.nominate_cycle_breakers(package)
    return {
        "rooms": len(children),
        "arrows": sum(map(len, drawing.values())),
        "back up": len(back),
        "drawing": drawing,
        "arrows back up": sorted(
            [one.rpartition(".")[2], other.rpartition(".")[2]] for one, other in back
        ),
    }


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
    if "drawing" not in result["now"]["bilevel"]:
        raise NotMeasured("layout")
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
        f"{table(head, rows)}\n\n{drawing(result)}\n\n"
        f"All Python files together had {before['lines']} lines before and have {now['lines']} "
        f"now. `import bilevel` takes {seconds['median']:.2f} s ({seconds['low']:.2f} to "
        f"{seconds['high']:.2f}).\n{source(result)}"
    )


def drawing(result: dict[str, Any]) -> str:
    """All arrows, before and now, room by room from the top."""
    parts = []
    for package in ("bilevel", "cluster"):
        for when in ("before", "now"):
            drawn = result[when][package]["drawing"]
            back = [tuple(arrow) for arrow in result[when][package]["arrows back up"]]
            lines = [
                f"{room:{max(map(len, drawn))}}  ->  "
                + ", ".join(f"*{o}*" if (room, o) in back else o for o in drawn[room])
                for room in from_the_top(drawn, back)
                if drawn[room]
            ]
            text = "\n".join(lines)
            parts.append(
                f"<details><summary>imports of <code>{package}</code> {when}</summary>\n\n"
                f"```\n{text}\n```\n</details>"
            )
    return "\n\n".join([*parts, "(In asterisks: an arrow back up.)"])


def from_the_top(drawn: dict[str, list[str]], back: list[tuple[str, ...]]) -> list[str]:
    """The rooms, each above those that it imports, except by the arrows `back`."""
    sorter = TopologicalSorter(
        {room: [o for o in others if (room, o) not in back] for room, others in drawn.items()}
    )
    return list(sorter.static_order())[::-1]


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
