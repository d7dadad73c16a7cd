"""The end of a process with all its children."""

import contextlib

import psutil

from bilevel.errors import InvalidInput

#: Seconds until a process that was asked to end is killed.
_PATIENCE = 15.0


def end_family(process: psutil.Process) -> None:
    """Ask a process to end, and kill what is left of it and its children after some seconds. Raises
    InvalidInput if it is another user's."""
    family = [process]
    with contextlib.suppress(psutil.NoSuchProcess):
        family += process.children(recursive=True)
        try:
            process.terminate()
        except psutil.AccessDenied:
            raise InvalidInput(
                f"the process {process.pid} belongs to {process.username()}, who alone can end it"
            ) from None
    _, alive = psutil.wait_procs(family, _PATIENCE)
    for left in alive:
        with contextlib.suppress(psutil.NoSuchProcess):
            left.kill()
    psutil.wait_procs(alive, _PATIENCE)
