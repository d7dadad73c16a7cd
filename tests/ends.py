"""Ends processes of tests at once, whether they are still there or not."""

import contextlib

import psutil


def kill(process: psutil.Process) -> None:
    """SIGKILL, unless the process has ended by itself meanwhile."""
    with contextlib.suppress(psutil.NoSuchProcess):
        process.kill()


def kill_family(process: psutil.Process) -> None:
    """Kill the process and all its children; return once they are gone."""
    with contextlib.suppress(psutil.NoSuchProcess):
        family = [*process.children(recursive=True), process]
        for member in family:
            kill(member)
        psutil.wait_procs(family, 30)
