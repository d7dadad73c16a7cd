"""Progress output: one line per event and, on a terminal, a live bar."""

import time
from contextlib import suppress
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn


def duration(seconds: float) -> str:
    """Format seconds as `42s`, `3m20s` or `2h05m`."""
    whole = max(round(seconds), 0)
    if whole < 60:
        return f"{whole}s"
    if whole < 3600:
        return f"{whole // 60}m{whole % 60:02d}s"
    return f"{whole // 3600}h{whole % 3600 // 60:02d}m"


def count(number: int, noun: str) -> str:
    """Format a number and a noun as `1 generation` or `3 generations`."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def last_line(text: str) -> str:
    """Return the last line of a text: the error in a traceback."""
    return next(reversed(text.strip().splitlines()), "")


class _Output(Console):
    """Standard output that discards its text once the reader of a pipe has ended, like `tee` after
    Ctrl-C. Rich would exit."""

    def on_broken_pipe(self) -> None:
        with suppress(SystemExit):
            super().on_broken_pipe()


class Terminal:
    """Print lines, above a progress bar if the output is a terminal.

    Errors of the output, such as a lost connection, are ignored: a signal stops the command.
    """

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or _Output(highlight=False, soft_wrap=True, emoji=False)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=12),
            TextColumn("{task.completed:.0f}/{task.total:.0f} {task.fields[unit]}"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[note]}", markup=False),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._task = self._bar.add_task("starting", total=1, unit="", note="")
        #: Start of the command (time.monotonic).
        self.started = time.monotonic()

    def __enter__(self) -> Self:
        with suppress(OSError):
            self._bar.start()
        return self

    def __exit__(self, *exc: object) -> None:
        with suppress(OSError):
            self._bar.stop()

    def log(self, text: str) -> None:
        """Print one line."""
        with suppress(OSError):
            self.console.print(text, markup=False)

    def bar(self, title: str, done: float, total: float, unit: str, note: str = "") -> None:
        """Update the bar."""
        with suppress(OSError):
            self._bar.update(
                self._task, description=title, completed=done, total=total, unit=unit, note=note
            )

    def step(self) -> None:
        """Advance the bar by one."""
        with suppress(OSError):
            self._bar.advance(self._task)
