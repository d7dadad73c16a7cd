"""Handling of Ctrl-C, SIGTERM and the end of the terminal, which stop a command cleanly."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

from cluster.session.terminal import Terminal


class InterruptGuard:
    """Turns the first of these signals within `orderly` into a flag.

    At any other time the signal raises KeyboardInterrupt, and `check` raises it again, because
    Python or a library may have swallowed the first one, as in a finaliser.
    """

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._orderly = False
        self.interrupted = False
        self.explained = False  # whether the terminal has told how to go on
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup wants it
                self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *exc: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @contextmanager
    def orderly(self) -> Iterator[None]:
        """Within the block the caller polls `interrupted` and stops its work itself."""
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
        again, self.interrupted = self.interrupted, True
        if again or not self._orderly:
            raise KeyboardInterrupt
        self._terminal.log("stopping cleanly; press Ctrl-C again to stop at once")
