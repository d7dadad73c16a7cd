"""Output on a terminal, in a pipe, and without a reader."""

import errno
import io
import math
import re
import time

import pytest
from rich.console import Console

from cluster.session.terminal import Terminal, duration


def terminal(is_terminal: bool, silence: float = 60.0) -> tuple[Terminal, io.StringIO]:
    out = io.StringIO()
    console = Console(
        file=out, width=100, force_terminal=is_terminal, color_system=None, soft_wrap=True
    )
    return Terminal(console, silence), out


def wait_for(text: str, out: io.StringIO) -> None:
    deadline = time.monotonic() + 30
    while text not in out.getvalue():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("is_terminal", [True, False])
def test_lines_are_not_broken(is_terminal: bool) -> None:
    shown, out = terminal(is_terminal)
    shown.log("a line " * 30)
    assert out.getvalue() == "a line " * 30 + "\n"


@pytest.mark.parametrize(
    ("eta", "remaining"), [(3600.0, r"ETA \S+, "), (0.0, ""), (1e-9, ""), (math.inf, "")]
)
def test_progress_lines_in_a_pipe(eta: float, remaining: str) -> None:
    shown, out = terminal(False, silence=0.01)
    shown.bar("training", 3, 9, "agents", "a try", eta=eta)
    shown.step()
    with shown:
        wait_for("so far", out)
    line = rf"\.\.\. training: 4 of 9 agents, {remaining}a try, \d+s so far\n"
    assert re.match(line, out.getvalue())


def test_bar_on_a_terminal() -> None:
    shown, out = terminal(True, silence=0.01)
    with shown:
        shown.bar("training", 3, 9, "agents", eta=7260.0)
        time.sleep(0.3)
        shown.log("a line")
    assert re.search(r"3/9 agents.*ETA 2h0[01]m", out.getvalue())
    assert "..." not in out.getvalue()


@pytest.mark.parametrize(
    ("seconds", "text"), [(-3, "0s"), (42.4, "42s"), (200, "3m20s"), (7500, "2h05m")]
)
def test_duration(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize("is_terminal", [True, False])
def test_errors_of_a_lost_terminal_are_ignored(is_terminal: bool) -> None:
    class Lost(io.StringIO):
        def write(self, text: str) -> int:
            raise OSError(errno.EIO, "Input/output error")

    with Terminal(Console(file=Lost(), force_terminal=is_terminal)) as shown:
        shown.log("a line")
        shown.bar("searching", 1, 2, "results")
        shown.step()
