"""Signals, also where Python or a pipe may swallow them."""

import signal
import subprocess
import sys

import pytest

from cluster.session.interrupts import InterruptGuard
from cluster.session.terminal import Terminal


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_interrupt_at_once(number: signal.Signals) -> None:
    previous = signal.getsignal(number)
    with InterruptGuard(Terminal()), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)
    assert signal.getsignal(number) is previous


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_check_repeats_an_interrupt_that_a_finaliser_swallowed() -> None:
    class Swallows:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    with InterruptGuard(Terminal()) as guard:
        guard.check()
        Swallows()
        with pytest.raises(KeyboardInterrupt):
            guard.check()


def test_the_first_signal_of_an_orderly_stop_sets_a_flag() -> None:
    with InterruptGuard(Terminal()) as guard:
        with guard.orderly():
            signal.raise_signal(signal.SIGINT)
            assert guard.interrupted
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            guard.check()


def test_orderly_stop_although_the_reader_of_the_output_has_ended() -> None:
    """Ctrl-C in `bilevel bohb ... | tee log` also ends `tee`."""
    code = """
import signal, sys
from cluster.session.interrupts import InterruptGuard
from cluster.session.terminal import Terminal
with Terminal() as terminal, InterruptGuard(terminal) as guard, guard.orderly():
    sys.stdin.readline()
    terminal.log("without a reader")
    signal.raise_signal(signal.SIGINT)
    terminal.log("without a reader")
sys.exit(7 if guard.interrupted else 0)
"""
    command, pipe = [sys.executable, "-c", code], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        assert process.stdout is not None
        process.stdout.close()
        _, errors = process.communicate(b"continue\n", timeout=60)
    assert (process.returncode, errors) == (7, b"")
