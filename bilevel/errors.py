"""The one kind of error that is the caller's to mend."""

from collections.abc import Iterable


class InvalidInput(ValueError):
    """A value from outside is not allowed. The message is one line that says
    what, which value, and what is allowed; the command line prints it and exits
    with code 2."""


def one_of(what: str, value: object, allowed: Iterable[object]) -> InvalidInput:
    """The error for a value that is none of the allowed ones."""
    names = ", ".join(str(name) for name in allowed)
    return InvalidInput(f"unknown {what} {value!r}: allowed are {names}")
