"""The compiler settings that every kernel shares."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

#: Reordering and contraction are allowed; `nnan` and `ninf` are left out on
#: purpose: with them a NaN compares as anything, and a diverged agent must be
#: recognised.
FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}


def _cache_folder() -> str:
    """Where machine code is kept: per state of the kernels' sources.

    Numba notices when the file of a function changes, but not when a function that
    it calls does, in another file; a digest of all kernels, and of what they share with
    the definitions, does.
    """
    here = Path(__file__).parent
    digest = hashlib.sha256()
    shared = [here.parent / f"{name}.py" for name in ("activations", "networks", "splitmix")]
    for source in [*sorted(here.glob("*.py")), *shared]:
        digest.update(source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    beside = here / "__pycache__"
    if os.access(beside if beside.exists() else here, os.W_OK):
        return str(beside / name)
    return str(Path.home() / ".cache" / "bilevel" / name)


_CACHE_FOLDER = _cache_folder()


def _compile(function: Callable[..., Any], fastmath: set[str]) -> Callable[..., Any]:
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _CACHE_FOLDER
    try:
        # Always inlined: a function left to be called exists in several libraries, each
        # optimised on its own, and which of them a call reaches depends on what the
        # process has compiled or loaded before. Their sums differ in the last bits.
        jitted: Callable[..., Any] = numba.njit(
            function,
            cache=True,
            nogil=True,
            error_model="numpy",
            fastmath=fastmath,
            forceinline=True,
        )
    finally:
        numba.config.CACHE_DIR = before
    return jitted


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile with Numba on first call; the machine code is cached on disk, so
    later processes (every actor on the node) load it instead of compiling."""
    return _compile(function, FAST_MATH)


def _approximated(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile for arguments that are not infinite: division and square root may
    then start from the processor's estimate and take one Newton step (2e-7)."""
    return _compile(function, FAST_MATH | {"ninf", "afn"})


@_approximated
def quotient(x, y):
    """x / y of floats that are not infinite; NaN stays NaN."""
    return x / y


@_approximated
def square_root(x):
    """The square root of a float that is not infinite; NaN stays NaN."""
    return np.sqrt(x)


@compiled
def is_finite(x):
    """Whether a float is neither infinite nor NaN.

    A comparison, because `np.isfinite` computes `x - x`, which reassociation turns
    into 0 whatever x is.
    """
    return abs(x) < np.inf
