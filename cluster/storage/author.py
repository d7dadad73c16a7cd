"""Provenance of a run: user, command line and source commit."""

import getpass
import re
import shlex
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import bilevel

#: User and password of a URI, before its host or among its parameters.
_SECRET = re.compile(r"(?<=://)[^/@\s]+(?=@)|(?<=password=)[^&\s]+")


@dataclass(frozen=True)
class Author:
    """User, command line and commit of the process that created a run."""

    user: str
    command: str
    commit: str  # of the source, as `commit` returns it

    @classmethod
    def of_this_process(cls) -> Self:
        """Return the author of runs that this process creates."""
        program, *arguments = sys.argv
        words = [Path(program).name, *map(without_password, arguments)]
        user = ""
        with suppress(KeyError, OSError):  # a container's user without a name
            user = getpass.getuser()
        return cls(user, shlex.join(words), commit())


def without_password(text: str) -> str:
    """Mask users and passwords of URIs in the text."""
    return _SECRET.sub("***", text)


def commit() -> str:
    """Return the commit of the source, or "" if the package does not run from a git checkout."""
    source = Path(bilevel.__file__).parents[1]
    if not (source / ".git").exists():
        return ""
    command = ["git", "-C", str(source), "rev-parse", "HEAD"]
    try:
        return subprocess.check_output(command, text=True, timeout=5).strip()
    except (OSError, subprocess.SubprocessError):
        return ""
