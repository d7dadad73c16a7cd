"""Agent files that a test loads."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def forgotten_afterwards() -> Iterator[None]:
    """Within the block, files may be loaded that imports find no more after it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path])
        patch.setattr(sys, "meta_path", [*sys.meta_path])
        patch.setattr("cluster.ray.agent_files._FILES", [])
        yield
