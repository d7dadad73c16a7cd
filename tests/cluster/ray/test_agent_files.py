import sys
from pathlib import Path

import pytest

from cluster.ray.agent_files import runtime_env
from tests.agent_files import forgotten_afterwards


def test_actors_of_a_joined_cluster_import_from_the_same_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of an own one inherit them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", "here:/there")
    assert runtime_env(own=True) is None
    told = runtime_env(own=False)
    assert told is not None
    with forgotten_afterwards():
        told["worker_process_setup_hook"]()
        assert sys.path[:2] == [str(tmp_path / "here"), "/there"]
    monkeypatch.delenv("PYTHONPATH")
    assert runtime_env(own=False) is None
