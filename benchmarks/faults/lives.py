"""`bilevel` in processes that may be killed at any moment, and begin within a second.

The processes are forked from a server that has imported what the command line needs; for
the rest they are what the console script is.
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


def start(arguments: Sequence[str], log: Path) -> BaseProcess:
    """`bilevel ARGUMENTS`, its output appended to `log`."""
    process = _SERVER.Process(target=_live, args=(list(arguments), log))
    process.start()
    return process


def _live(arguments: list[str], log: Path) -> None:
    from cluster.cli import main

    os.setsid()  # signals of this terminal are not for it
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    sys.argv = ["bilevel", *arguments]
    with contextlib.suppress(KeyboardInterrupt):
        main()
