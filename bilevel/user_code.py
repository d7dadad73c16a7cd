"""Code of users, in agents and real tasks: its errors, and digests of its source."""

import inspect
import linecache
import sysconfig
import traceback
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

from bilevel.durable import checksum
from bilevel.errors import InvalidInput

#: Folders of the standard library, of installed packages and of this package.
_LIBRARIES = (*map(sysconfig.get_path, ("stdlib", "purelib")), f"{Path(__file__).parent}/")


class UserCodeError(InvalidInput):
    """A user's agent or task raised, exited or returned a wrong value. It never becomes a score."""


@dataclass(frozen=True)
class user_code_errors:  # noqa: N801  used as a function; a generator would cost each step 1 us
    """Context that runs code of `name` (as in "agent 'mine'"). Errors and exits raise UserCodeError
    with the line that raised. It may be entered again."""

    name: str
    doing: str

    def __enter__(self) -> None:
        """Start the code."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Replace the code's error."""
        if isinstance(error, UserCodeError) or not isinstance(error, Exception | SystemExit):
            return
        frames = traceback.extract_tb(trace)
        own = [frame for frame in frames if not frame.filename.startswith(_LIBRARIES)]
        place = f" at {own[-1].filename}:{own[-1].lineno}" if own else ""
        prefix = "" if isinstance(error, InvalidInput) else f"{type(error).__name__}: "
        message = " ".join(f"{prefix}{error}".split()).removesuffix(":")
        raise UserCodeError(f"{self.name}{place}, when it {self.doing}: {message}") from None


def digest_of(package: str, *code: Any) -> str | None:
    """Return a digest of the source files that define these functions and classes, except for
    members of `package`; None if no file is left."""
    files = set()
    for given in code:
        while isinstance(given, partial):
            given = given.func
        given = inspect.unwrap(given)
        if not (inspect.isroutine(given) or inspect.isclass(given)):
            given = type(given)
        if (getattr(given, "__module__", None) or "").partition(".")[0] != package:
            with suppress(OSError, TypeError):
                files.add(inspect.getsourcefile(given) or "")
    # An agent file is in linecache as it was when it was imported.
    sources = ["".join(linecache.getlines(file)).encode() for file in sorted(files)]
    return checksum(*sources)[:16] if sources else None
