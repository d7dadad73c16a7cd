"""User-defined agents and real tasks: locations of their mistakes, and digests of their source."""

import inspect
import linecache
import os
import sysconfig
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from bilevel.durable import checksum
from bilevel.errors import InvalidInput

#: Folders of the standard library, of installed packages and of this package.
_LIBRARIES = (
    *(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")),
    str(Path(__file__).parent) + os.sep,
)


class UserCodeError(InvalidInput):
    """A user's agent or task returned a wrong value, raised, or exited; the message names file and
    line. A mistake never becomes a score."""


def mistake_at(name: str, code: Any, message: str) -> UserCodeError:
    """The mistake of `name` (as in "agent 'mine'") in a function or class."""
    return UserCodeError(f"{name}{_source_of(code)}: {message}")


@contextmanager
def user_code_errors(name: str, code: Any, doing: str) -> Iterator[None]:
    """Context in which `name` runs the function or class `code`; errors and exits become a
    UserCodeError."""
    try:
        yield
    except UserCodeError:
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if not frame.filename.startswith(_LIBRARIES)]
        place = f" at {own[-1].filename}:{own[-1].lineno}" if own else _source_of(code)
        message = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
        raise UserCodeError(f"{name}{place}, when it {doing}: {message}") from None


def digest_of(package: str, *code: Any) -> str | None:
    """Digest of the source files that define these functions and classes, except for members of
    `package`; None if no file is left."""
    files = set()
    for definition in map(_definition, code):
        if (getattr(definition, "__module__", None) or "").partition(".")[0] != package:
            with suppress(OSError, TypeError):
                files.add(inspect.getsourcefile(definition) or "")
    # An agent file is in linecache as it was when it was imported.
    sources = ["".join(linecache.getlines(file)).encode() for file in sorted(files)]
    return checksum(*sources)[:16] if sources else None


def _definition(code: Any) -> Any:
    """The function or class behind a partial, a decorator or a callable object."""
    while isinstance(code, partial):
        code = code.func
    code = inspect.unwrap(code)
    return code if inspect.isroutine(code) or inspect.isclass(code) else type(code)


def _source_of(code: Any) -> str:
    """The location of a function or class; empty for code without a file."""
    with suppress(OSError, TypeError):
        source = inspect.unwrap(code)
        return f" at {inspect.getsourcefile(source)}:{inspect.getsourcelines(source)[1]}"
    return ""
