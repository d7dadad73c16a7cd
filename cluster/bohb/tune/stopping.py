"""Stops a study before its brackets are complete: time budget, Ctrl-C, full disk."""

from typing import Any

from ray import tune

from cluster.bohb.tune.searcher import BohbSearcher, DriverOnly
from cluster.session.interrupts import InterruptGuard


class StudyStopper(DriverOnly, tune.Stopper):  # type: ignore[misc]
    """Stops all trials at the deadline, after an error such as a full disk, or after Ctrl-C."""

    def __init__(self, searcher: BohbSearcher, guard: InterruptGuard) -> None:
        self._searcher = searcher
        self._guard = guard

    def __call__(self, trial_id: str, result: dict[str, Any]) -> bool:
        """Never stop a single trial."""
        return False

    def stop_all(self) -> bool:
        """Return True at the deadline, after an error, or after Ctrl-C."""
        searcher = self._searcher
        return self._guard.interrupted or searcher.time_is_up or searcher.stopped_by is not None
