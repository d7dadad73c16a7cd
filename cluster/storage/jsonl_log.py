"""Append-only JSON lines files.

A line counts once it is flushed to disk with its newline. Readers ignore a truncated last line,
left by a crash or a full disk, and the next append overwrites it.
"""

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
    """A JSON lines file. `values` are the values read at the start and those appended since.

    Raises InvalidInput for a complete line that is not JSON. Reading does not change the file.
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
        self.values: list[Any] = []
        for index, line in enumerate(data[: self._end].split(b"\n")[:-1]):
            try:
                self.values.append(json.loads(line))
            except (ValueError, RecursionError) as error:
                raise self.damaged(index, error) from None

    def decoded(self, kind: type[_T]) -> list[_T]:
        """Return the values as instances of that type. Raises InvalidInput if one does not fit."""
        return [decode(kind, value, self._line(index)) for index, value in enumerate(self.values)]

    def damaged(self, index: int, reason: object) -> InvalidInput:
        """Return the error to raise if the value at `index` (from 0) is invalid."""
        return InvalidInput(f"{self._line(index)}: {' '.join(str(reason).split())}")

    def _line(self, index: int) -> str:
        return f"damaged file {str(self.path)!r}, line {index + 1}"

    def append(self, value: Any) -> None:
        """Append a value durably. Raises StorageFailure if it cannot be written."""
        line = json.dumps(value).encode() + b"\n"
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            new = not self.path.exists()
            with self.path.open("wb" if new else "r+b", buffering=0) as file:
                file.truncate(self._end)
                file.seek(self._end)
                if file.write(line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                os.fsync(file.fileno())
            if new:
                sync(self.path.parent)
        except OSError as error:
            raise StorageFailure.of(self.path, error) from None
        self._end += len(line)
        self.values.append(value)
