"""When a study stops before its brackets are done: time spent, Ctrl-C, no room."""

from typing import Any

from ray import tune

from cluster.bohb.searcher import BohbSearcher, DriverOnly
from cluster.session.interrupts import InterruptGuard


class StudyStopper(DriverOnly, tune.Stopper):  # type: ignore[misc]
    """Stops all trials when the time is up, the disk is full, or the user asked."""

    def __init__(self, searcher: BohbSearcher, guard: InterruptGuard) -> None:
        self._searcher = searcher
        self._guard = guard

    def __call__(self, trial_id: str, result: dict[str, Any]) -> bool:
        return False

    def stop_all(self) -> bool:
        searcher = self._searcher
        return self._guard.interrupted or searcher.time_is_up or searcher.stopped_by is not None
