"""Outcome of a study without measured times, and its comparison with an undisturbed study."""

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
    """Everything in a study's folder that the seed determines."""

    configs: list[Any]  # (id, configuration, info), in order
    results: list[Any]  # (id, budget, loss, exception), in order
    states: dict[str, Any]  # checkpoints by configuration and run
    best_se: str  # checksum of the file

    @classmethod
    def of(cls, folder: Path) -> "Outcome":
        """Read the outcome from a study's folder."""
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

    def sorted(self) -> "Outcome":
        """Return the outcome with sorted results, because parallel trials end in any order.

        The order could influence BOHB's model, which studies this short do not use.
        """
        return replace(self, results=sorted(self.results, key=lambda row: row[:2]))


def comparable_state(path: Path) -> Any:
    """Return checksums of a checkpoint's tensors, and its header without measured times."""
    with safe_open(path, framework="numpy") as file:
        header = json.loads(file.metadata()["nes"])
        tensors = {name: file.get_tensor(name).tobytes() for name in file.keys()}  # noqa: SIM118
    del header["sha256"]  # covers the times
    for record in header["state"]["records"]:
        for name in TIMES:
            del record[name]
    return {name: hashlib.sha256(content).hexdigest() for name, content in tensors.items()}, header


@dataclass(frozen=True)
class Row:
    """Effects of a fault, compared with an undisturbed study."""

    fault: str
    injected: int
    results: int
    lost: int
    duplicated: int
    identical: bool  # journal, checkpoints and best SE, without measured times
    mlflow: list[str]  # differences between MLflow and the disk
    exit_code: int

    @classmethod
    def compare(
        cls,
        fault: str,
        injected: int,
        exit_code: int,
        reference: Outcome,
        outcome: Outcome,
        mlflow: list[str],
    ) -> "Row":
        """Compare the outcome of a disturbed study with the reference."""
        expected, found = ([row[:2] for row in one.results] for one in (reference, outcome))
        lost, duplicated = len({*expected} - {*found}), len(found) - len(Counter(found))
        same = outcome == reference
        return cls(fault, injected, len(found), lost, duplicated, same, mlflow, exit_code)
