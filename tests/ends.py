"""Kill processes of tests, which may have ended already."""

import contextlib

import psutil


def kill(process: psutil.Process) -> None:
    """Send SIGKILL unless the process has ended."""
    with contextlib.suppress(psutil.NoSuchProcess):
        process.kill()


def kill_family(process: psutil.Process) -> None:
    """Kill the process and all its children, and wait until they have ended."""
    with contextlib.suppress(psutil.NoSuchProcess):
        family = [*process.children(recursive=True), process]
        for member in family:
            kill(member)
        psutil.wait_procs(family, 30)
