"""Compiler settings of all kernels."""

import atexit
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
import numpy as np

#: Allow reordering and contraction. `nnan` and `ninf` are left out: they make comparisons with
#: NaN undefined, and diverged agents could not be detected.
FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}

#: The compiler's options for a kernel. It is inlined, because the compiler may order its sums:
#: separately optimised copies of a function would differ in the last bits, and the copy that a call
#: reaches depends on the kernels that the process has compiled or loaded before.
OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": FAST_MATH,
    "forceinline": True,
}


def cache_folder() -> Path:
    """Create and return the folder of the cached machine code: in NUMBA_CACHE_DIR, this package or
    the user's cache, else a temporary folder of this process. Its name contains a digest of the
    sources, since Numba notices a change in a function's own file only."""
    package, digest = Path(__file__).parent, hashlib.sha256()
    shared = (package.parent / f"{name}.py" for name in ("networks", "splitmix"))
    for source in [*sorted(package.glob("*.py")), *shared]:
        digest.update(source.read_bytes())
    places = [package / "__pycache__", Path("~/.cache/bilevel")]
    if numba.config.CACHE_DIR:  # from NUMBA_CACHE_DIR
        places.insert(0, Path(numba.config.CACHE_DIR).absolute())
    for place in places:
        with suppress(OSError, RuntimeError):  # RuntimeError: no home folder is known
            folder = place.expanduser() / f"kernels-{digest.hexdigest()[:16]}"
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
    temporary = tempfile.mkdtemp(prefix="bilevel-kernels-")
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    return Path(temporary)


_CACHE_FOLDER = str(cache_folder())


def _compile(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """Compile with `OPTIONS`, except for the given ones."""
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _CACHE_FOLDER
    try:
        jitted: Callable[..., Any] = numba.njit(function, cache=True, **(OPTIONS | options))
    finally:
        numba.config.CACHE_DIR = before
    return jitted


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile with Numba on first call, or load the machine code from the disk cache."""
    return _compile(function)


def compiled_apart(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that orders its sums itself. It is not inlined, which shortens the
    compilation of kernels that call it often."""
    return _compile(function, forceinline=False)


def _approximated(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile for finite or NaN arguments: division and square root may then use the processor's
    estimate and one Newton step (relative error 2e-7)."""
    return _compile(function, fastmath=FAST_MATH | {"ninf", "afn"})


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
    """Return True for a finite float. (`np.isfinite` computes `x - x`, which reassociation turns
    into 0 for every x.)"""
    return abs(x) < np.inf


@compiled
def all_finite(values):
    """Return True if all floats of a vector are finite; their sum need not be."""
    finite = True
    for value in values:
        finite &= is_finite(value)
    return finite
