"""Ctrl-C in places where Python may swallow it."""

import signal

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


def test_any_other_is_an_interrupt() -> None:
    with InterruptGuard(Terminal()), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)
