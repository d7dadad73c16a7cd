"""Where a command works."""

import json
import os
import threading
from collections.abc import Iterator
from dataclasses import asdict
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import psutil
import pytest

from cluster.cli.places import the_address
from cluster.services.background import Service, boot_id, since_boot
from cluster.storage.home import Home

HEAD = "127.0.0.1:6399"


class _Well(BaseHTTPRequestHandler):
    """A service that answers."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Home]:
    """A home whose Ray head, which this process stands for, wants a token."""
    for name in ("RAY_ADDRESS", "RAY_AUTH_MODE"):
        monkeypatch.setenv(name, "")  # to be put back
        monkeypatch.delenv(name)
    with HTTPServer(("127.0.0.1", 0), _Well) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        page, us = f"http://127.0.0.1:{server.server_port}/", psutil.Process()
        token = {"RAY_AUTH_MODE": "token"}
        head = Service("ray", us.pid, since_boot(us), HEAD, page, page, "log", token, boot_id())
        (tmp_path / "services.json").write_text(json.dumps([asdict(head)]))
        yield Home(tmp_path)
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("given", [None, "auto", HEAD])
def test_the_homes_head_is_joined_with_its_token(given: str | None, home: Home) -> None:
    assert the_address(given, home) == HEAD
    assert os.environ["RAY_AUTH_MODE"] == "token"


@pytest.mark.parametrize(
    ("given", "of_job", "joined"),
    [
        ("local", None, None),
        ("other:6379", None, "other:6379"),
        (None, "other:6379", "other:6379"),
        ("auto", "other:6379", "other:6379"),
    ],
)
def test_other_clusters_get_no_token(
    given: str | None,
    of_job: str | None,
    joined: str | None,
    home: Home,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if of_job is not None:
        monkeypatch.setenv("RAY_ADDRESS", of_job)
    if given is not None and given != "auto":
        (home.folder / "services.json").write_text("damaged")  # matters to nobody
    assert the_address(given, home) == joined
    assert "RAY_AUTH_MODE" not in os.environ


def test_without_a_head_auto_is_rays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    assert the_address("auto", Home(tmp_path)) == "auto"
    assert the_address(None, Home(tmp_path)) is None
