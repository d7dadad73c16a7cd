"""Joining the services that `up` started."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import asdict, replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import psutil
import pytest

from bilevel import InvalidInput
from cluster.services import background
from cluster.services.background import Service, boot_id, down, join, since_boot, up
from cluster.services.ports import free_port
from cluster.storage.home import Home
from cluster.storage.run_folder import held


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
        "ray", process.pid, since_boot(process), "127.0.0.1:1", health, health, "log", {}, boot_id()
    )
    home = Home(tmp_path)
    (tmp_path / "services.json").write_text(json.dumps([asdict(service)]))
    with pytest.raises(InvalidInput, match=rf"ray.* \(process {process.pid}\) but does not answer"):
        join("ray", home)
    assert join("mlflow", home) is None
    process.kill()
    process.wait()
    assert join("ray", home) is None


def test_a_change_of_the_clock_moves_no_service(
    process: psutil.Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = Service("ray", process.pid, since_boot(process), "", "", "", "log", {}, boot_id())
    later = psutil.boot_time() + 3600.0
    for module in ("psutil", "psutil._pslinux"):
        monkeypatch.setattr(f"{module}.boot_time", lambda: later)
    assert service.process is not None
    assert replace(service, boot="another").process is None


def test_a_proxy_is_not_asked_for_a_service_of_this_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Well(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:
            pass

    monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{free_port()}")
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
    with HTTPServer(("127.0.0.1", 0), Well) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            assert background._answers(f"http://127.0.0.1:{server.server_port}/")
        finally:
            server.shutdown()
            thread.join()


def test_down_tells_of_runs_that_it_may_end(tmp_path: Path) -> None:
    home, told = Home(tmp_path), list[str]()
    folder = home.run_folder("CartPole-v0", "at-work")
    folder.mkdir(parents=True)
    (folder / "settings.json").write_text("{}")
    gone = json.dumps([asdict(Service("ray", 1, 0.0, "", "", "", "log", {}))])
    with held(folder):
        (tmp_path / "services.json").write_text(gone)
        down(home, told.append)
    (tmp_path / "services.json").write_text(gone)
    down(home, told.append)
    assert told[0].startswith("CartPole-v0/at-work is being run: if by this Ray head, it ends")
    assert told[1:] == ["ray was gone"] * 2


def test_a_damaged_record_tells_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "services.json").write_text("{")
    with pytest.raises(InvalidInput, match=r"^damaged .*services.json'.*; delete it, and end what"):
        down(Home(tmp_path), print)


def test_two_ups_at_once_are_refused(tmp_path: Path) -> None:
    home = Home(tmp_path)
    with background._alone(home), pytest.raises(InvalidInput, match="is under way in"):
        up(home, "127.0.0.1", free_port(), free_port(), free_port(), print)
    (tmp_path / "services.json").write_text(
        json.dumps([asdict(Service("ray", 1, 0.0, "", "", "", "log", {}))])
    )
    with background._alone(home), pytest.raises(InvalidInput, match="is under way in"):
        down(home, print)
