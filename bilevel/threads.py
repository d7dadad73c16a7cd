"""Limits of BLAS and torch to one thread: products are small, other evaluations use the other
cores, and a fixed order of summation keeps results reproducible.

Evaluations on several threads may overlap, so the limit of BLAS counts its users.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

import scipy.linalg.cython_blas  # noqa: F401  (the BLAS of compiled code, loaded to be limited)
from threadpoolctl import OpenBLASController, ThreadpoolController

_CONTROLLER = ThreadpoolController()
_LOCK = Lock()
_users = 0
_restore: Callable[[], None]


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context in which BLAS uses one thread. The limit applies to the process; the last context
    that ends removes it."""
    global _users, _restore
    with _LOCK:
        if not _users:
            _release_control()
            _restore = _CONTROLLER.limit(limits=1, user_api="blas").restore_original_limits
        _users += 1
    try:
        yield
    finally:
        with _LOCK:
            _users -= 1
            if not _users:
                _release_control()
                _restore()
                _release_control()


def _release_control() -> None:
    """Allow any thread to set the number of threads: threadpoolctl reserves this for the thread
    that did it first."""
    OpenBLASController.clear_controlling_thread(force=True)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Context in which torch uses one thread. Torch counts per thread."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
