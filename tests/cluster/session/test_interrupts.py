"""Ctrl-C in places where Python may swallow it."""

import signal
import subprocess
import sys

import pytest

from cluster.session.interrupts import InterruptGuard
from cluster.session.terminal import Terminal


class Swallows:
    """An object with a finaliser, in which Python ignores exceptions."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_what_a_finaliser_swallows_is_raised_again(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with InterruptGuard(Terminal()) as guard:
        guard.check()
        Swallows(number)
        with pytest.raises(KeyboardInterrupt):
            guard.check()
    assert signal.getsignal(number) is before


def test_the_first_one_in_order_is_a_flag() -> None:
    with InterruptGuard(Terminal()) as guard:
        with guard.orderly():
            signal.raise_signal(signal.SIGINT)
            assert guard.interrupted
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            guard.check()


def test_a_pipe_without_a_reader_keeps_it_in_order() -> None:
    """As in `bilevel bohb ... | tee log`, where Ctrl-C ends `tee` too."""
    code = """
import signal, sys
from cluster.session.interrupts import InterruptGuard
from cluster.session.terminal import Terminal
with Terminal() as terminal, InterruptGuard(terminal) as guard, guard.orderly():
    sys.stdin.readline()
    terminal.log("nobody reads this")
    signal.raise_signal(signal.SIGINT)
    terminal.log("nor this")
sys.exit(7 if guard.interrupted else 0)
"""
    command, pipe = [sys.executable, "-c", code], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as one:
        assert one.stdout is not None
        one.stdout.close()
        _, errors = one.communicate(b"go on\n", timeout=60)
    assert (one.returncode, errors) == (7, b"")


def test_any_other_is_an_interrupt() -> None:
    with InterruptGuard(Terminal()), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)
