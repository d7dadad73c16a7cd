"""Imports of actors. Loading in the driver is tested with the agents."""

import sys
from pathlib import Path

import pytest

from bilevel.agents import registered_agents
from cluster.ray.agent_files import load_agent_file, runtime_env
from tests.agent_files import forgotten_afterwards
from tests.documents import documented_agent


def test_actors_of_a_joined_cluster_import_from_pythonpath(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", "here:/there")
    assert runtime_env(local=True) is None
    environment = runtime_env(local=False)
    assert environment is not None
    with forgotten_afterwards():
        environment["worker_process_setup_hook"]()
        assert sys.path[:2] == [str(tmp_path / "here"), "/there"]
    monkeypatch.delenv("PYTHONPATH")
    assert runtime_env(local=False) is None


def test_actors_import_agent_files_as_the_driver_has_read_them(tmp_path: Path) -> None:
    file = tmp_path / "sent_agent.py"
    file.write_text(documented_agent().replace('"reinforce"', '"sent"'))
    with forgotten_afterwards():
        for _ in range(2):  # the second call changes nothing
            load_agent_file(file)
            assert "sent" in registered_agents()
        environment = runtime_env(local=True)
        assert environment is not None
        file.unlink()
        driver = sys.modules.pop("sent_agent")
        environment["worker_process_setup_hook"]()
        assert sys.modules["sent_agent"] is not driver
        assert sys.modules["sent_agent"].__file__ == str(file)
