"""One BLAS thread: the products are small, the cores belong to other evaluations, and sums
in a fixed order keep results the same everywhere."""

from contextlib import AbstractContextManager
from typing import Any

import scipy.linalg.cython_blas  # noqa: F401  (the BLAS of compiled code, loaded to be limited)
from threadpoolctl import ThreadpoolController

_CONTROLLER = ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[Any]:
    """The limit, as long as the context lasts."""
    limit: AbstractContextManager[Any] = _CONTROLLER.limit(limits=1, user_api="blas")
    return limit
