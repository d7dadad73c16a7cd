"""When a study stops before its brackets are done: time spent, or Ctrl-C."""

import signal
from types import FrameType
from typing import Any, Self

from ray import tune

from cluster.bohb.searcher import BohbSearcher, DriverOnly
from cluster.progress import Terminal


class InterruptGuard:
    """Turns the first Ctrl-C (or SIGTERM) into a flag; the second one acts at once."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self.interrupted = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *exc: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        self._terminal.line("stopping after what is in flight; once more stops at once")


class StudyStopper(DriverOnly, tune.Stopper):  # type: ignore[misc]
    """Stops all trials when the time is up or the user asked for it."""

    def __init__(self, searcher: BohbSearcher, guard: InterruptGuard) -> None:
        self._searcher = searcher
        self._guard = guard

    def __call__(self, trial_id: str, result: dict[str, Any]) -> bool:
        return False

    def stop_all(self) -> bool:
        return self._guard.interrupted or self._searcher.time_is_up
