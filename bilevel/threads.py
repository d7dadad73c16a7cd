"""Limits of BLAS and torch to one thread: products are small, other evaluations use the other
cores, and a fixed order of summation keeps results reproducible.

Several threads of a process may be in a limit at a time, each once. BLAS has its threads back when
the last one has left, torch when each has left, since its number of threads is each thread's own.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

import scipy.linalg.cython_blas  # noqa: F401  (the BLAS of compiled code, loaded to be limited)
from threadpoolctl import OpenBLASController, ThreadpoolController

_CONTROLLER = ThreadpoolController()
_LOCK = Lock()


class _BLAS:
    """The limit of BLAS, whose number of threads is the process's."""

    inside = 0
    restore: Callable[[], None]


class _Torch:
    """The limit of torch, whose number of threads is each thread's own."""

    inside = 0
    before = 1


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context in which BLAS uses one thread."""
    with _LOCK:
        if not _BLAS.inside:
            _yield_control()
            limit = _CONTROLLER.limit(limits=1, user_api="blas")
            _BLAS.restore = limit.restore_original_limits
        _BLAS.inside += 1
    try:
        yield
    finally:
        with _LOCK:
            _BLAS.inside -= 1
            if not _BLAS.inside:
                _yield_control()
                _BLAS.restore()
                _yield_control()


def _yield_control() -> None:
    """Let whichever thread comes next set the number of threads; threadpoolctl lets only the one do
    so that did it first."""
    OpenBLASController.clear_controlling_thread(force=True)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Context in which torch uses one thread."""
    import torch

    with _LOCK:
        if not _Torch.inside:
            _Torch.before = torch.get_num_threads()
        _Torch.inside += 1
        torch.set_num_threads(1)
    try:
        yield
    finally:
        with _LOCK:
            _Torch.inside -= 1
            torch.set_num_threads(_Torch.before)
