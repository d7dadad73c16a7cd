"""Starts `bilevel` in processes that may be killed at any moment, and start within a second.

The processes are forked from a server that has imported the command line's modules; otherwise they
equal the console script.
"""

import contextlib
import multiprocessing
import os
import sys
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path

_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["benchmarks.faults.preload"])


def start(
    arguments: Sequence[str], log: Path, errors: Path | None = None, cwd: Path | None = None
) -> BaseProcess:
    """Start `bilevel ARGUMENTS` with the current environment; append stdout to `log` and stderr to
    `errors`."""
    where = str(cwd or Path.cwd())
    process = _SERVER.Process(
        target=_live, args=(list(arguments), log, errors or log, where, dict(os.environ))
    )
    process.start()
    return process


def _live(
    arguments: list[str], log: Path, errors: Path, cwd: str, environment: dict[str, str]
) -> None:
    from cluster.cli import main

    os.setsid()  # protect the process from signals of this terminal
    for path, stream in ((log, 1), (errors, 2)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(cwd)
    sys.argv = ["bilevel", *arguments]
    with contextlib.suppress(KeyboardInterrupt):
        main()
