"""Who began a run, by which command, from which state of the source."""

import getpass
import itertools
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import bilevel

#: User and password of a URI; a password, which comes after a colon, may hold a slash.
_USER = re.compile(r"(?<=://)(?:[^/@\s]+|[^/:@\s]*:(?!\d+/)[^@\s]*)@")
#: A password among the parameters of a database's address.
_SECRET = re.compile(r"((?:^|[?&;])(?:password|pwd|passwd|odbc_connect)=)[^&;\s]+", re.IGNORECASE)


@dataclass(frozen=True)
class Author:
    """User, command line and commit, as MLflow shows them in fields of its own."""

    user: str
    command: str
    commit: str  # of the code, as `commit` returns it

    @property
    def program(self) -> str:
        """The command without its options, which may hold paths: MLflow shows what comes after the
        last slash."""
        words = itertools.takewhile(
            lambda word: not word.startswith("-"), shlex.split(self.command)
        )
        return " ".join(word for word in words if "/" not in word)

    @classmethod
    def of_this_process(cls) -> Self:
        """The author of runs that this process begins."""
        program, *arguments = sys.argv
        arguments = [without_password(argument) for argument in arguments]
        return cls(_user(), shlex.join([Path(program).name, *arguments]), commit())


def without_password(text: str) -> str:
    """The text without users and passwords in its URIs, such as those of databases."""
    return _SECRET.sub(r"\1***", _USER.sub("***@", text))


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a container's user without an entry in the password file
        return ""


def commit() -> str:
    """The commit of the code; empty unless the package runs from a git checkout."""
    source = Path(bilevel.__file__).parents[1]
    if not (source / ".git").exists():
        return ""
    command = ["git", "-C", str(source), "rev-parse", "HEAD"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return found.stdout.strip()
