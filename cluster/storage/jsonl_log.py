"""Append-only JSON lines files.

A line counts once it is flushed to disk with its newline. A last line that was cut short, by a
crash or a full disk, never counted: readers skip it, and the next append overwrites it.
"""

import contextlib
import errno
import json
import os
from pathlib import Path
from typing import Any, TypeVar

from bilevel.decode import decode
from bilevel.durable import sync
from bilevel.errors import InvalidInput, StorageFailure

_T = TypeVar("_T")


class JsonlLog:
    """A JSON lines file: `values` are those read at the start and those appended since.

    Raises InvalidInput for a complete line that is not JSON. Reading does not change the file,
    so other processes may read while one process writes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            data = b""
        except OSError as error:
            raise InvalidInput(f"cannot read {str(path)!r}: {error.strerror}") from None
        self._end = data.rfind(b"\n") + 1
        self.values = [
            self._parsed(number, line)
            for number, line in enumerate(data[: self._end].split(b"\n")[:-1], start=1)
        ]

    def decoded(self, kind: type[_T]) -> list[_T]:
        """The values as that type. Raises InvalidInput for one of another form."""
        return [
            decode(kind, value, self._damaged(index)) for index, value in enumerate(self.values)
        ]

    def damaged(self, index: int, reason: object) -> InvalidInput:
        """The error to raise if the value at `index` (from 0) is invalid."""
        text = " ".join(str(reason).split()) or type(reason).__name__
        return InvalidInput(f"{self._damaged(index)}: {text}")

    def _damaged(self, index: int) -> str:
        return f"damaged file {str(self.path)!r}, line {index + 1}"

    def append(self, value: Any) -> None:
        """Append a value durably. Raises StorageFailure, with nothing appended."""
        line = json.dumps(value).encode() + b"\n"
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            new = not self.path.exists()
            with self.path.open("wb" if new else "r+b", buffering=0) as file:
                file.truncate(self._end)
                file.seek(self._end)
                try:
                    if file.write(line) != len(line):  # the disk is full
                        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                    os.fsync(file.fileno())
                except OSError:
                    with contextlib.suppress(OSError):
                        file.truncate(self._end)
                    raise
            if new:
                sync(self.path.parent)
        except OSError as error:
            raise StorageFailure.of(self.path, error) from None
        self._end += len(line)
        self.values.append(value)

    def _parsed(self, number: int, line: bytes) -> Any:
        try:
            return json.loads(line)
        except (ValueError, RecursionError) as error:
            raise self.damaged(number - 1, error) from None
