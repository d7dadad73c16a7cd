"""Progress output: one line per event and, on a terminal, a live bar."""

import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from bilevel.nes import GenerationRecord


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


class Terminal:
    """Prints lines above a progress bar; the bar is left out if the output is no terminal."""

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or Console(highlight=False, soft_wrap=True)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=12),
            TextColumn("{task.completed:.0f}/{task.total:.0f} {task.fields[unit]}"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[note]}"),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._task = self._bar.add_task("starting", total=1, unit="", note="")
        #: Start of the command (time.monotonic).
        self.started = time.monotonic()

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def line(self, text: str) -> None:
        """Print one line."""
        self.console.print(text, markup=False)

    def bar(self, what: str, done: float, total: float, unit: str, note: str = "") -> None:
        """Set the bar's title, progress and note."""
        self._bar.update(
            self._task, description=what, completed=done, total=total, unit=unit, note=note
        )

    def step(self) -> None:
        """Advance the bar by one."""
        self._bar.advance(self._task)


def generation_line(record: GenerationRecord, best: float) -> str:
    """Summary of a generation in one line."""
    return (
        f"generation {record.generation:3d}   score {record.score_mean:7.1f} "
        f"± {record.score_std:5.1f}   best {best:7.1f}   train steps {record.train_steps_mean:6.0f}"
        f"   {record.env_steps_per_second / 1000:5.1f}k steps/s"
        f"   {record.generation_seconds:5.1f}s"
    )
