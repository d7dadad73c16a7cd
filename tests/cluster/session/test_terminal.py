"""Output on a terminal, in a pipe, and without a reader."""

import errno
import io
import re

import pytest
from rich.console import Console

from cluster.session.terminal import Terminal, duration


def terminal(is_terminal: bool) -> tuple[Terminal, io.StringIO]:
    out = io.StringIO()
    console = Console(
        file=out, width=100, force_terminal=is_terminal, color_system=None, soft_wrap=True
    )
    return Terminal(console), out


@pytest.mark.parametrize("is_terminal", [True, False])
def test_lines_are_not_broken(is_terminal: bool) -> None:
    shown, out = terminal(is_terminal)
    shown.log("a line " * 30)
    assert out.getvalue() == "a line " * 30 + "\n"


@pytest.mark.parametrize(("is_terminal", "bars"), [(True, 1), (False, 0)])
def test_bar(is_terminal: bool, bars: int) -> None:
    shown, out = terminal(is_terminal)
    with shown:
        shown.bar("training", 2, 9, "agents", "a [try]")
        shown.step()
        shown.log("a line")
    assert len(re.findall(r"3/9 agents .*a \[try\]", out.getvalue())) >= bars
    assert "a line\n" in out.getvalue()


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
