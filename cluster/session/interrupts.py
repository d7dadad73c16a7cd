"""Ctrl-C, and SIGTERM, which stops what is run as orderly."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

from cluster.session.terminal import Terminal


class InterruptGuard:
    """Ctrl-C (or SIGTERM) within `orderly` becomes a flag, the first time; at any other time
    it is a KeyboardInterrupt, which `check` raises again: it may have come where Python or a
    library swallows it, as in a finaliser."""

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

    def check(self) -> None:
        """Raises KeyboardInterrupt if there was one."""
        if self.interrupted:
            raise KeyboardInterrupt

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        again, self.interrupted = self.interrupted, True
        if again or not self._orderly:
            raise KeyboardInterrupt
        self._terminal.line("stopping after what is in flight; once more stops at once")
