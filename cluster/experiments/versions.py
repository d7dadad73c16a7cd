"""Versions of what results rest on."""

import platform
from importlib.metadata import PackageNotFoundError, version

from bilevel.version import __version__

_PACKAGES = ("numpy", "numba", "scipy", "torch", "gymnasium", "ray", "mlflow", "matplotlib")


def versions() -> dict[str, str]:
    """Versions of this package, Python and the packages that results may depend on."""
    found = {"bilevel": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "-"
    return found
