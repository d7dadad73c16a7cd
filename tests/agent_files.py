"""Agent files in tests."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from cluster.ray.agent_files import LOADED


@contextmanager
def forgotten_afterwards() -> Iterator[None]:
    """Start without agent files, and restore them and the import path after the block."""
    files, path = [*LOADED], [*sys.path]
    LOADED.clear()
    try:
        yield
    finally:
        LOADED[:], sys.path[:] = files, path
