"""When a study stops before its brackets are done: time spent, Ctrl-C, no room."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

from ray import tune

from cluster.bohb.searcher import BohbSearcher, DriverOnly
from cluster.progress import Terminal


class InterruptGuard:
    """Ctrl-C (or SIGTERM) within `orderly` becomes a flag, the first time; at any
    other time it is a KeyboardInterrupt."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._orderly = False
        self.interrupted = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *exc: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @contextmanager
    def orderly(self) -> Iterator[None]:
        """Within the block someone asks for `interrupted` and ends what is in flight."""
        self._orderly = True
        try:
            yield
        finally:
            self._orderly = False

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted or not self._orderly:
            raise KeyboardInterrupt
        self.interrupted = True
        self._terminal.line("stopping after what is in flight; once more stops at once")


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
