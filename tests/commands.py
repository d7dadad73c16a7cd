"""Run `bilevel ARGUMENTS` in a forked process that has the imports already, or as a script."""

import contextlib
import multiprocessing
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path

#: The console script.
BILEVEL = str(Path(sys.executable).with_name("bilevel"))

#: Processes are forked from a server that has imported the modules of the command line.
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(
    [
        "mlflow.pyfunc",
        "ray.tune",
        "cluster.bohb.command",
        "cluster.cli.program",
        "cluster.evaluate.command",
        "cluster.experiments.report",
        "cluster.nes.command",
        "cluster.catalog",
    ]
)


def start_bilevel(
    arguments: Sequence[str], out: Path, errors: Path | None = None, cwd: Path | None = None
) -> BaseProcess:
    """Start the command with the current environment variables. Its output is appended to the file
    `out`, and its standard error to `errors` (default: `out`)."""
    where = str(cwd or Path.cwd())
    process = _SERVER.Process(
        target=_run, args=(list(arguments), out, errors or out, where, dict(os.environ))
    )
    process.start()
    return process


def run_bilevel(
    *arguments: str | Path, cwd: Path | None = None, timeout: float = 280
) -> subprocess.CompletedProcess[str]:
    """Run the command and return its result. Raises TimeoutError with the output so far."""
    words = [str(argument) for argument in arguments]
    with tempfile.TemporaryDirectory() as folder:
        out, errors = Path(folder) / "out", Path(folder) / "errors"
        process = start_bilevel(words, out, errors, cwd)
        process.join(timeout)
        alive = process.is_alive()
        if alive:
            process.kill()
            process.join()
        written = [path.read_text() if path.exists() else "" for path in (out, errors)]
        if alive:
            raise TimeoutError(f"bilevel {' '.join(words)}: {written}")
        return subprocess.CompletedProcess(words, process.exitcode or 0, *written)


def _run(
    arguments: list[str], out: Path, errors: Path, cwd: str, environment: dict[str, str]
) -> None:
    from cluster.cli import main

    os.setsid()  # signals of this terminal do not reach the process
    for path, stream in ((out, 1), (errors, 2)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(cwd)
    sys.argv = ["bilevel", *arguments]
    with contextlib.suppress(KeyboardInterrupt):
        main()


def free_port() -> int:
    """Return an unused port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def listening(host: str, port: int) -> bool:
    """Return whether a server accepts connections on the port."""
    with socket.socket() as probe:
        return probe.connect_ex((host, port)) == 0
