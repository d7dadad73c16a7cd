"""Limits of BLAS and torch to one thread: products are small, other evaluations use the other
cores, and a fixed order of summation keeps results reproducible.

Evaluations on several threads may overlap, so each limit counts its users.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

import scipy.linalg.cython_blas  # noqa: F401  (the BLAS of compiled code, loaded to be limited)
from threadpoolctl import OpenBLASController, ThreadpoolController

_CONTROLLER = ThreadpoolController()
_LOCK = Lock()
_users = {"blas": 0, "torch": 0}
_torch_threads = 1
_restore_blas: Callable[[], None]


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context in which BLAS uses one thread. The limit applies to the process; the last context
    that ends removes it."""
    global _restore_blas
    with _LOCK:
        if not _users["blas"]:
            _release_control()
            limit = _CONTROLLER.limit(limits=1, user_api="blas")
            _restore_blas = limit.restore_original_limits
        _users["blas"] += 1
    try:
        yield
    finally:
        with _LOCK:
            _users["blas"] -= 1
            if not _users["blas"]:
                _release_control()
                _restore_blas()
                _release_control()


def _release_control() -> None:
    """Allow any thread to set the number of threads: threadpoolctl reserves this for the thread
    that did it first."""
    OpenBLASController.clear_controlling_thread(force=True)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Context in which torch uses one thread. Torch counts per thread, and new threads inherit the
    number that was set last."""
    import torch

    global _torch_threads
    with _LOCK:
        if not _users["torch"]:
            _torch_threads = torch.get_num_threads()
        _users["torch"] += 1
        torch.set_num_threads(1)
    try:
        yield
    finally:
        with _LOCK:
            _users["torch"] -= 1
            torch.set_num_threads(_torch_threads)
