"""Code that users write, agents and real tasks: its mistakes, and whether it has changed.

A mistake must not become a score. It is told in one line with its place in the user's file,
wherever the evaluation runs. And a run that has used several versions of the code says so.
"""

import inspect
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

#: Folders of code that users did not write.
_LIBRARIES = tuple(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))
_OURS = str(Path(__file__).parent) + os.sep


class Mistake(InvalidInput):
    """An agent or a task of a user's returned what it must not, raised, or exited; the message
    tells where."""


def mistake_at(what: str, code: Any, message: str) -> Mistake:
    """The mistake of `what` (as in "agent 'mine'") in a function or class."""
    return Mistake(f"{what}{_source_of(code)}: {message}")


@contextmanager
def as_mistake(what: str, code: Any, doing: str) -> Iterator[None]:
    """Within the block, in which `what` calls the function or class `code`, errors and exits become
    a Mistake."""
    try:
        yield
    except Mistake:
        raise
    except (Exception, SystemExit) as error:
        told = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        place = _place_of(error, code) or _source_of(code)
        raise Mistake(f"{what}{place}, when it {doing}: {' '.join(told.split())}") from None


def digest_of(package: str, *code: Any) -> str | None:
    """Digest of the files that define these functions and classes, which are no user's if they are
    of `package`; None if they have no files."""
    files = {}
    for one in map(_defined, code):
        if (getattr(one, "__module__", None) or "").partition(".")[0] == package:
            continue
        with suppress(OSError, TypeError):
            file = inspect.getsourcefile(one) or ""
            loader = getattr(inspect.getmodule(one), "__loader__", None)
            files[file] = getattr(loader, "get_data", _content)(file)
    return checksum(*(files[file] for file in sorted(files)))[:16] if files else None


def _content(file: str) -> bytes:
    return Path(file).read_bytes()


def _defined(code: Any) -> Any:
    """The function or class behind what is called: a partial of it, an object of the class."""
    while isinstance(code, partial):
        code = code.func
    code = inspect.unwrap(code)
    return code if inspect.isroutine(code) or inspect.isclass(code) else type(code)


def _source_of(code: Any) -> str:
    """Where a function or class begins; empty for code without a file."""
    with suppress(OSError, TypeError):
        source = inspect.unwrap(code)
        return f" at {inspect.getsourcefile(source)}:{inspect.getsourcelines(source)[1]}"
    return ""


def _place_of(error: BaseException, code: Any) -> str:
    """The last call in the file of `code`, else in code that is neither ours nor a library's."""
    frames = traceback.extract_tb(error.__traceback__)
    file = None
    with suppress(OSError, TypeError):
        file = inspect.getsourcefile(inspect.unwrap(code))
    own = [f for f in frames if f.filename == file and file != __file__]
    own = own or [f for f in frames if not f.filename.startswith((*_LIBRARIES, _OURS))]
    return f" at {own[-1].filename}:{own[-1].lineno}" if own else ""
