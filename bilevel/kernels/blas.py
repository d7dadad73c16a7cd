"""Limits BLAS to one thread: products are small, other evaluations use the other cores, and a
fixed order of summation keeps results reproducible."""

from contextlib import AbstractContextManager
from typing import Any

import scipy.linalg.cython_blas  # noqa: F401  (the BLAS of compiled code, loaded to be limited)
from threadpoolctl import ThreadpoolController

_CONTROLLER = ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[Any]:
    """Context in which BLAS uses one thread."""
    limit: AbstractContextManager[Any] = _CONTROLLER.limit(limits=1, user_api="blas")
    return limit
