"""Errors that users can fix: invalid values, and full or broken disks."""

from collections.abc import Iterable
from numbers import Real
from pathlib import Path
from typing import Self


class InvalidInput(ValueError):
    """An input value is not allowed.

    The message is one line with the value and the allowed values. The command line prints it and
    exits with code 2.
    """


class StorageFailure(InvalidInput):
    """The disk is full, read-only, broken or unreachable.

    No file is half-written. Once the disk works, the same command resumes.
    """

    @classmethod
    def of(cls, path: Path, error: OSError) -> Self:
        """Describe the failure to write `path`."""
        return cls(f"cannot write {str(path)!r}: {error.strerror or error}")


class OtherVersion(InvalidInput):
    """A file has the format of another version of this package."""

    def __init__(self, what: str, written: object, known: int) -> None:
        super().__init__(
            f"{what} has format {written}, this version reads format {known}: resume with the "
            "version that wrote it, or start a new run under another name"
        )


def first_line(error: BaseException) -> str:
    """Return the first line of an error's message, or its type if the message is empty."""
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def require(kind: type, value: object, what: str, how: str) -> None:
    """Raise InvalidInput unless `value` is an instance of `kind`; `how` names its source."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InvalidInput(f"{what} must be {article} {kind.__name__}, {how}; got {value!r:.60}")


def is_number(value: object, kind: type = Real) -> bool:
    """Return whether `value` is a number of that kind; booleans are not numbers."""
    return isinstance(value, kind) and not isinstance(value, bool)


def unknown_value(what: str, value: object, allowed: Iterable[object]) -> InvalidInput:
    """Return the error for a `value` that is not among the allowed ones."""
    names = ", ".join(str(name) for name in allowed)
    return InvalidInput(f"unknown {what} {value!r}: allowed are {names}")
