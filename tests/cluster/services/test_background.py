"""Joining the services that `up` started."""

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import psutil
import pytest

from bilevel import InvalidInput
from cluster.services import background
from cluster.services.background import Service, join
from cluster.services.ports import free_port
from cluster.storage.home import Home


@pytest.fixture
def process() -> Iterator[psutil.Process]:
    """A process that lives, but answers nobody."""
    waiting = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield psutil.Process(waiting.pid)
    waiting.kill()
    waiting.communicate()


def test_a_service_that_does_not_answer_is_not_replaced_in_silence(
    process: psutil.Process, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a Ray head on a machine under load: a second one beside it would share its cores."""
    monkeypatch.setattr(background, "PATIENCE", 0.0)
    health = f"http://127.0.0.1:{free_port()}/"
    service = Service(
        "ray", process.pid, process.create_time(), "127.0.0.1:1", health, health, "log", {}
    )
    home = Home(tmp_path)
    (tmp_path / "services.json").write_text(json.dumps([asdict(service)]))
    with pytest.raises(InvalidInput, match=rf"ray.* \(process {process.pid}\) but does not answer"):
        join("ray", home)
    assert join("mlflow", home) is None
    process.kill()
    process.wait()
    assert join("ray", home) is None
