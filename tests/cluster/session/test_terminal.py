"""What the terminal shows, and what a pipe gets."""

import errno
import io
import math
import re
import time

import pytest
from rich.console import Console

from cluster.session.terminal import Terminal, duration


def terminal(width: int, is_terminal: bool, silence: float = 60.0) -> tuple[Terminal, io.StringIO]:
    out = io.StringIO()
    console = Console(
        file=out,
        width=width,
        force_terminal=is_terminal,
        color_system=None,
        highlight=False,
        soft_wrap=True,
    )
    return Terminal(console, silence), out


TEXT = "  evaluations took 93% of the time, and /a/path/that/is-not-to-be-broken/anywhere ends it"


def test_a_terminal_wraps_between_words() -> None:
    shown, out = terminal(30, True)
    shown.log(TEXT)
    lines = out.getvalue().splitlines()
    assert len(lines) > 2
    assert all(line.startswith("  ") for line in lines)
    assert " ".join(line.strip() for line in lines) == TEXT.strip()
    # what is longer than a line is one word
    assert [line.strip() for line in lines if len(line) > 30] == [TEXT.split()[-3]]


def test_a_pipe_gets_one_line() -> None:
    shown, out = terminal(30, False)
    shown.log(TEXT)
    assert out.getvalue() == TEXT + "\n"


def test_a_silent_pipe_is_told_the_progress() -> None:
    shown, out = terminal(80, False, silence=0.01)
    shown.bar("choosing the start", 3, 288, "evaluations", "a try", eta=3600.0)
    shown.step()
    told = r"\.\.\. choosing the start: 4 of 288 evaluations, ETA \S+m?, a try, \d+s so far\n"
    with shown:
        deadline = time.monotonic() + 30
        while not re.match(told, out.getvalue()):
            assert time.monotonic() < deadline
            time.sleep(0.01)


@pytest.mark.parametrize("eta", [0.0, 1e-9, math.inf])
def test_a_time_that_is_over_or_unknown_is_not_told(eta: float) -> None:
    shown, out = terminal(80, False, silence=0.01)
    shown.bar("training", 3, 9, "agents", eta=eta)
    with shown:
        deadline = time.monotonic() + 30
        while "so far" not in out.getvalue():
            assert time.monotonic() < deadline
            time.sleep(0.01)
    assert re.match(r"\.\.\. training: 3 of 9 agents, \d+s so far\n", out.getvalue())


def test_the_bar_of_a_terminal_counts_down() -> None:
    shown, out = terminal(100, True)
    with shown:
        shown.bar("training", 3, 9, "agents", eta=7260.0)
        time.sleep(0.3)
    assert re.search(r"3/9 agents.*ETA 2h0[01]m", out.getvalue())


def test_nothing_is_added_to_the_lines_of_a_terminal() -> None:
    shown, out = terminal(80, True, silence=0.01)
    with shown:
        time.sleep(0.2)
        shown.log("all is told")
    assert "..." not in out.getvalue()


@pytest.mark.parametrize(
    ("seconds", "text"), [(-3, "0s"), (42.4, "42s"), (200, "3m20s"), (7500, "2h05m")]
)
def test_duration(seconds: float, text: str) -> None:
    assert duration(seconds) == text


class Gone(io.StringIO):
    """A terminal whose connection has ended."""

    def write(self, text: str) -> int:
        raise OSError(errno.EIO, "Input/output error")


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_terminal_that_is_gone_stops_nothing(is_terminal: bool) -> None:
    """The signal that tells of it stops the command, in order."""
    console = Console(file=Gone(), force_terminal=is_terminal)
    with pytest.raises(OSError, match="Input/output error"):
        console.print("a line")
    with Terminal(console) as shown:
        shown.log("a line")
        shown.bar("searching", 1, 2, "results")
        shown.step()
