"""The compiler settings that every kernel shares."""

from collections.abc import Callable
from typing import Any

import numba

#: Reordering and contraction are allowed; `nnan` and `ninf` are left out on
#: purpose: with them a NaN compares as anything, and a diverged agent must be
#: recognised.
FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile with Numba on first call; the machine code is cached on disk, so
    later processes (every actor on the node) load it instead of compiling."""
    jitted: Callable[..., Any] = numba.njit(
        function, cache=True, nogil=True, error_model="numpy", fastmath=FAST_MATH
    )
    return jitted
