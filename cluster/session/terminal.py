"""Progress output: one line per event and, on a terminal, a live bar."""

import math
import threading
import time
from contextlib import suppress
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.text import Text

#: Seconds without output after which a progress line is printed if no bar shows the progress.
SILENCE = 25.0


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


def _remarks(task: Task) -> str:
    """Return the remaining time, if it is known and positive, and the note."""
    remaining = task.fields["end"] - time.monotonic()
    eta = f"ETA {duration(remaining)}" if 0 < remaining < math.inf else ""
    return ", ".join(part for part in (eta, task.fields["note"]) if part)


class _Remarks(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(_remarks(task))


class _Output(Console):
    """Standard output that discards its text once the reader of a pipe has ended, like `tee` after
    Ctrl-C. Rich would exit."""

    def on_broken_pipe(self) -> None:
        with suppress(SystemExit):
            super().on_broken_pipe()


class Terminal:
    """Print lines above a progress bar, or progress lines if the output is not a terminal.

    A progress line appears after `silence` seconds without output. Errors of the output (a lost ssh
    connection, for instance) are ignored, because a signal then stops the command in order.
    """

    def __init__(self, console: Console | None = None, silence: float = SILENCE) -> None:
        self.console = console or _Output(highlight=False, soft_wrap=True, emoji=False)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=12),
            TextColumn("{task.completed:.0f}/{task.total:.0f} {task.fields[unit]}"),
            TimeElapsedColumn(),
            _Remarks(),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._task = self._bar.add_task("starting", total=1, unit="", note="", end=0.0)
        #: Start of the command (time.monotonic).
        self.started = time.monotonic()
        self._silence = silence
        self._last_output = self.started
        self._closed = threading.Event()

    def __enter__(self) -> Self:
        with suppress(OSError):
            self._bar.start()
        if not self.console.is_terminal:
            threading.Thread(target=self._print_progress, name="progress", daemon=True).start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._closed.set()
        with suppress(OSError):
            self._bar.stop()

    def log(self, text: str) -> None:
        """Print one line."""
        self._last_output = time.monotonic()
        with suppress(OSError):
            self.console.print(text, markup=False)

    def bar(
        self, title: str, done: float, total: float, unit: str, note: str = "", eta: float = 0.0
    ) -> None:
        """Update the bar. An `eta` (remaining seconds) of 0 or infinity is not shown."""
        with suppress(OSError):
            self._bar.update(
                self._task,
                description=title,
                completed=done,
                total=total,
                unit=unit,
                note=note,
                end=time.monotonic() + eta,
            )

    def step(self) -> None:
        """Advance the bar by one."""
        with suppress(OSError):
            self._bar.advance(self._task)

    def _print_progress(self) -> None:
        while not self._closed.wait(min(self._silence, 1.0)):
            now = time.monotonic()
            if now - self._last_output >= self._silence:
                task = self._bar.tasks[0]
                done = f"{task.completed:.0f} of {task.total:.0f} {task.fields['unit']}".rstrip()
                parts = [done, _remarks(task), f"{duration(now - self.started)} so far"]
                self.log(f"... {task.description}: {', '.join(part for part in parts if part)}")
