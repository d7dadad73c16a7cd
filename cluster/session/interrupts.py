"""Orderly stop after Ctrl-C, SIGTERM or the end of the terminal (SIGHUP)."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

from cluster.session.terminal import Terminal


class InterruptGuard:
    """Handle these signals within a context.

    Inside `orderly` the first signal only sets a flag. Otherwise a signal raises KeyboardInterrupt,
    and `check` raises it again, because a finaliser or a library may have swallowed it.
    """

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._orderly = False
        self.interrupted = False
        self.explained = False  # whether a message has explained how to resume
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:  # set by nohup
                self._previous[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *exc: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    @contextmanager
    def orderly(self) -> Iterator[None]:
        """Let the caller poll `interrupted` and stop its work itself during the block."""
        self._orderly = True
        try:
            yield
        finally:
            self._orderly = False

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has arrived."""
        if self.interrupted:
            raise KeyboardInterrupt

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        repeated, self.interrupted = self.interrupted, True
        if repeated or not self._orderly:
            raise KeyboardInterrupt
        self._terminal.log("stopping cleanly; press Ctrl-C again to stop at once")
