"""Agent files in tests."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def forgotten_afterwards() -> Iterator[None]:
    """Restore the import path and the list of agent files after the block."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path])
        patch.setattr("cluster.ray.agent_files.LOADED", [])
        yield
