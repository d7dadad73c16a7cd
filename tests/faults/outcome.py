"""Outcome of a study for comparison: all its results without the measured times."""

import hashlib
import json
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from safetensors import safe_open

from cluster.bohb.study.journal import Journal

#: Measured fields of a generation's record.
TIMES = (
    "evaluation_seconds",
    "env_steps_per_second",
    "generation_seconds",
    "core_utilisation",
    "finished",
)


@dataclass(frozen=True)
class Outcome:
    """Everything that a seed determines."""

    configs: list[Any]  # (id, configuration, info), in order
    results: list[Any]  # (id, budget, loss, exception), in order
    states: dict[str, Any]  # by configuration and run: its checkpoint
    best_se: str  # checksum of the file

    @classmethod
    def of(cls, folder: Path) -> "Outcome":
        """Read from a study's folder."""
        journal = Journal(folder)
        return cls(
            [(line.id, line.configuration, line.info) for line in journal.configs],
            [(line.id, line.budget, line.loss, line.exception) for line in journal.results],
            {
                str(path.relative_to(folder)): comparable_state(path)
                for path in folder.glob("configurations/*/*/state.safetensors")
            },
            hashlib.sha256((folder / "best_se.safetensors").read_bytes()).hexdigest(),
        )

    def lost(self, other: "Outcome") -> int:
        """Number of results that the other outcome lacks."""
        return len({row[:2] for row in self.results} - {row[:2] for row in other.results})

    @property
    def duplicated(self) -> int:
        """Number of duplicate results."""
        counts = Counter(row[:2] for row in self.results)
        return sum(count - 1 for count in counts.values())

    def in_any_order(self) -> "Outcome":
        """The outcome with sorted results, because several trials at a time end in any order. (The
        order could influence BOHB's model, which studies this short do not use.)"""
        return replace(self, results=sorted(self.results, key=lambda row: row[:2]))


def comparable_state(path: Path) -> Any:
    """A checkpoint as checksums of its tensors and its header without the measured times.

    The raw file is read, so that all of it is compared.
    """
    with safe_open(path, framework="numpy") as file:
        header = json.loads(file.metadata()["nes"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    del header["sha256"]  # it depends on the times
    for record in header["records"]:
        for name in TIMES:
            del record[name]
    digests = {
        name: hashlib.sha256(tensor.tobytes()).hexdigest() for name, tensor in tensors.items()
    }
    return digests, header
