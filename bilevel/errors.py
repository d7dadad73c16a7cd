"""The one kind of error that is the caller's to mend: bad values, and full disks."""

from collections.abc import Iterable
from pathlib import Path
from typing import Self


class InvalidInput(ValueError):
    """A value from outside is not allowed. The message is one line that says
    what, which value, and what is allowed; the command line prints it and exits
    with code 2."""


class StorageFailure(InvalidInput):
    """The disk is full, read-only, broken or away. Nothing was half-written, and what is
    on disk counts: once that is mended, the same command goes on."""

    @classmethod
    def of(cls, path: Path, error: OSError) -> Self:
        """What happened when that path was to be written."""
        return cls(f"cannot write {str(path)!r}: {error.strerror or error}")


def one_of(what: str, value: object, allowed: Iterable[object]) -> InvalidInput:
    """The error for a value that is none of the allowed ones."""
    names = ", ".join(str(name) for name in allowed)
    return InvalidInput(f"unknown {what} {value!r}: allowed are {names}")
