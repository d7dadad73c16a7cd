"""Errors that the user can fix: invalid values, and full or broken disks."""

from collections.abc import Iterable
from numbers import Real
from pathlib import Path
from typing import Self


class InvalidInput(ValueError):
    """An input value is not allowed.

    The message is one line that names the value and what is allowed; the command line prints it
    and exits with code 2.
    """


class StorageFailure(InvalidInput):
    """The disk is full, read-only, broken or unreachable.

    Nothing was half-written; once the disk works, the same command resumes.
    """

    @classmethod
    def of(cls, path: Path, error: OSError) -> Self:
        """The failure to write `path`, caused by `error`."""
        return cls(f"cannot write {str(path)!r}: {error.strerror or error}")


class OtherVersion(InvalidInput):
    """A version of this package with another format wrote a file."""

    def __init__(self, what: str, written: object, known: int) -> None:
        super().__init__(
            f"{what} has format {written}, this version reads format {known}: resume with the "
            "version that began it, or begin anew under another name"
        )


def first_line(error: BaseException) -> str:
    """The first line of an error's message, or its type."""
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def require(kind: type, value: object, what: str, how: str) -> None:
    """Raise InvalidInput unless the value is of that kind; `how` tells where one comes from."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InvalidInput(f"{what} must be {article} {kind.__name__}, {how}; got {value!r:.60}")


def is_number(value: object, kind: type = Real) -> bool:
    """Whether a value from outside is a number of that kind; a boolean is none."""
    return isinstance(value, kind) and not isinstance(value, bool)


def one_of(what: str, value: object, allowed: Iterable[object]) -> InvalidInput:
    """The error for a `value` of the kind `what` that is not among the allowed ones."""
    names = ", ".join(str(name) for name in allowed)
    return InvalidInput(f"unknown {what} {value!r}: allowed are {names}")
