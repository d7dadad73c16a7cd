"""Progress output: one line per event and, on a terminal, a live bar."""

import contextlib
import math
import os
import sys
import textwrap
import threading
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.text import Text


def duration(seconds: float) -> str:
    """Seconds as `42s`, `3m20s` or `2h05m`."""
    whole = max(round(seconds), 0)
    if whole < 60:
        return f"{whole}s"
    if whole < 3600:
        return f"{whole // 60}m{whole % 60:02d}s"
    return f"{whole // 3600}h{whole % 3600 // 60:02d}m"


def count(number: int, noun: str) -> str:
    """Number and noun, as `1 generation` or `3 generations`."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def last_line(text: str) -> str:
    """The last line of a text: in a traceback, the error."""
    return next(reversed(text.strip().splitlines()), "")


#: Seconds of silence after which progress is told where no bar shows it.
SILENCE = 25.0


def _remarks(task: Task) -> str:
    """The time left, which counts down until it is over, and the note."""
    left = task.fields["end"] - time.monotonic()
    eta = f"ETA {duration(left)}" if 0 < left < math.inf else ""
    return ", ".join(part for part in (eta, task.fields["note"]) if part)


class _Remarks(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(_remarks(task))


class _Output(Console):
    """Standard output; what is printed after its reader has gone is lost, and stops nothing."""

    def __init__(self) -> None:
        super().__init__(highlight=False, soft_wrap=True, emoji=False)

    def on_broken_pipe(self) -> None:
        """The reader of a pipe is gone, as `tee` after Ctrl-C."""
        self.quiet = True
        # What Python writes at its end must not fail either.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


class Terminal:
    """Prints lines above a progress bar. If the output is no terminal, a line tells the progress
    instead whenever nothing else has been printed for `silence` seconds.

    On a terminal lines are wrapped between words; elsewhere a line is never broken. A terminal that
    is gone, as when a connection by ssh ends, or the reader of a pipe, stops nothing: a signal does
    that, in order.
    """

    def __init__(self, console: Console | None = None, silence: float = SILENCE) -> None:
        self.console = console or _Output()
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
        self._spoke = self.started
        self._over = threading.Event()

    def __enter__(self) -> Self:
        with contextlib.suppress(OSError):
            self._bar.start()
        if not self.console.is_terminal:
            threading.Thread(target=self._break_silence, name="progress", daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._over.set()
        with contextlib.suppress(OSError):
            self._bar.stop()

    def log(self, text: str) -> None:
        """Print one line; if it is wrapped, all parts are indented like the first."""
        self._spoke = time.monotonic()
        with contextlib.suppress(OSError):
            for part in self._wrapped(text):
                self.console.print(part, markup=False)

    def _wrapped(self, text: str) -> list[str]:
        if not self.console.is_terminal or len(text) <= self.console.width:
            return [text]
        indent = text[: len(text) - len(text.lstrip())]
        return textwrap.wrap(
            text,
            self.console.width,
            subsequent_indent=indent,
            break_long_words=False,  # paths and addresses can then be copied
            break_on_hyphens=False,
            replace_whitespace=False,
            drop_whitespace=True,
        )

    def _break_silence(self) -> None:
        while not self._over.wait(min(self._silence, 1.0)):
            if time.monotonic() - self._spoke >= self._silence:
                task = self._bar.tasks[0]
                progress = (
                    f"{task.completed:.0f} of {task.total:.0f} {task.fields['unit']}".rstrip()
                )
                elapsed = duration(time.monotonic() - self.started)
                parts = [progress, _remarks(task), f"{elapsed} so far"]
                self.log(f"... {task.description}: {', '.join(part for part in parts if part)}")

    def bar(
        self, what: str, done: float, total: float, unit: str, note: str = "", eta: float = 0.0
    ) -> None:
        """Set the bar's title, progress, note, and the seconds that are left; 0 or infinity are
        not shown."""
        with contextlib.suppress(OSError):
            self._bar.update(
                self._task,
                description=what,
                completed=done,
                total=total,
                unit=unit,
                note=note,
                end=time.monotonic() + eta,
            )

    def step(self) -> None:
        """Advance the bar by one."""
        with contextlib.suppress(OSError):
            self._bar.advance(self._task)
