"""MLflow mirrors the disk, also if it was unreachable, locked, empty or out of date."""

import json
import re
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import mlflow
import pytest

from bilevel import InvalidInput
from cluster.bohb.view import StudyViews
from cluster.catalog import sync, views_of
from cluster.session.context import RunContext
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from cluster.storage.run_folder import held
from cluster.tracking import Mirror, Tracker
from cluster.tracking.tracker import KEY
from tests.mlflow_shown import Server, disagreements
from tests.studies import make_study

pytestmark = pytest.mark.timeout(120)


@pytest.fixture
def home(tmp_path: Path, database: Path) -> Home:
    home = Home(tmp_path / "home")
    home.prepare()
    shutil.copy(database, home.folder)
    return home


@pytest.fixture
def folder(home: Home) -> Path:
    """Folder of a finished study with a failed job."""
    folder = home.run_folder("CartPole-v0", "made")
    make_study(folder, fail=(1,))
    return folder


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, database: Path) -> Iterator[Server]:
    """A server for all tests, which leave it running. Every study has its own UUID."""
    with Server(tmp_path_factory.mktemp("server"), empty=database) as server:
        yield server


def client_of(home: Home) -> mlflow.MlflowClient:
    return mlflow.MlflowClient(home.database_uri, registry_uri=home.database_uri)


def mirror_of(folder: Path, uri: str, log: Callable[[str], None]) -> tuple[Mirror, list[str]]:
    """A mirror of a study, and the keys of its runs."""
    views = StudyViews(folder)
    tracker = Tracker(uri, "CartPole-v0", Home(folder.parents[1]))
    return Mirror(tracker, views.view, log), views.keys()


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline, "timeout"
        time.sleep(0.05)


def test_sync_rebuilds_a_study_in_an_empty_database(home: Home, folder: Path) -> None:
    for _ in range(2):  # the second call changes nothing
        sync(folder, home, home.database_uri, Terminal())
        assert disagreements(folder, home.database_uri) == []
    client = client_of(home)
    assert len(client.search_model_versions("name = 'SE-CartPole-v0'")) == 1
    best = client.get_model_version_by_alias("SE-CartPole-v0", "best")
    (parent,) = client.search_runs(["1"], "tags.`bilevel.kind` = 'study'")
    assert best.run_id == parent.info.run_id
    (failed,) = client.search_runs(["1"], "attributes.status = 'FAILED'")
    assert failed.data.tags["bilevel.error"] == "ValueError: made to fail"
    assert failed.data.tags["mlflow.parentRunId"] == parent.info.run_id


def test_four_runs_may_start_at_once_in_a_new_home(tmp_path: Path) -> None:
    """MLflow creates the tables of a new database without a lock."""
    go = tmp_path / "go"
    code = (
        "import pathlib, sys, time, mlflow;"
        "from cluster.storage.home import Home; from cluster.tracking import Tracker;"
        "home = Home(pathlib.Path(sys.argv[1]) / 'home'); print('ready', flush=True);"
        "[time.sleep(0.001) for _ in iter(pathlib.Path(sys.argv[1], 'go').exists, True)];"
        "Tracker(home.database_uri, 'CartPole-v0', home)"
    )
    command = [sys.executable, "-W", "ignore", "-c", code, str(tmp_path)]
    pipe = subprocess.PIPE
    processes = [subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) for _ in range(4)]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    go.touch()
    for process in processes:
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors


def test_sync_completes_a_run(home: Home, folder: Path) -> None:
    """It was created twice after a timeout, and a damaged checkpoint was computed again."""
    views = views_of(folder)
    parent, child, *_ = views.keys()
    tracker = Tracker(home.database_uri, "CartPole-v0", home)
    tracker.show(views.view(parent))
    view = views.view(child)
    earlier = tuple(replace(point, time=point.time - 9) for point in view.points)
    tracker.show(replace(view, points=earlier))
    twin = client_of(home).create_run("1", tags={KEY: child})
    client_of(home).log_metric(twin.info.run_id, "score_mean", 1.0, step=0)
    assert disagreements(folder, home.database_uri) != []
    sync(folder, home, home.database_uri, Terminal())
    assert disagreements(folder, home.database_uri) == []


def test_sync_reports_a_rejected_run(
    home: Home, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = StudyViews.view
    monkeypatch.setattr(
        StudyViews, "view", lambda self, key: replace(view(self, key), params={"a|b": 1})
    )
    with pytest.raises(InvalidInput, match=r"made: MLflow rejects the run \("):
        sync(folder, home, home.database_uri, Terminal())


@pytest.mark.parametrize(("score", "best"), [(100.0, "newer"), (99.0, "made")])
def test_the_aliases_do_not_depend_on_the_order_of_registration(
    home: Home, folder: Path, score: float, best: str
) -> None:
    newer = home.run_folder("CartPole-v0", "newer")
    make_study(newer, score=score)
    for study in (newer, folder):
        sync(study, home, home.database_uri, Terminal())
    client = client_of(home)
    for alias, name in (("best", best), ("newest", "newer")):
        version = client.get_model_version_by_alias("SE-CartPole-v0", alias)
        assert client.get_run(version.run_id or "").info.run_name == name


def test_sync_leaves_a_running_study_alone(home: Home, folder: Path) -> None:
    with held(folder), pytest.raises(InvalidInput, match="being run by another process"):
        sync(folder, home, home.database_uri, Terminal())


def test_a_restarted_server_gets_everything_once(folder: Path, server: Server) -> None:
    log: list[str] = []
    mirror, keys = mirror_of(folder, server.uri, log.append)
    mirror.mark(keys[:2])
    wait_for(lambda: keys[0] not in mirror.waiting)
    server.kill()
    mirror.mark(keys)
    wait_for(lambda: bool(log))
    assert f"MLflow at {server.uri} is unreachable" in log[0]
    assert "\n" not in log[0]
    server.start()
    wait_for(lambda: len(log) > 1)
    assert log[1:] == ["MLflow is reachable again and catches up"]
    assert mirror.close() == 0
    assert disagreements(folder, server.uri) == []


def test_sync_writes_the_runs_that_an_unreachable_server_missed(
    home: Home, folder: Path, server: Server, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = json.loads((folder / "settings.json").read_text())
    context = RunContext(home, server.uri)
    with context.offline() as driver, driver.session(folder, "CartPole-v0", settings) as session:
        server.kill()
        with session.live(StudyViews(folder), 1, "resume it"):
            pass
    server.start()
    out = " ".join(capsys.readouterr().out.split())
    options = f"--tracking-uri {server.uri} --home {home.folder}"
    assert f"sync CartPole-v0/made {options}` writes" in out
    sync(folder, home, server.uri, Terminal())
    assert disagreements(folder, server.uri) == []


def test_later_runs_of_a_command_start_while_mlflow_is_unreachable(
    home: Home, folder: Path, server: Server
) -> None:
    """The NES runs of an experiment have separate sessions."""
    settings = json.loads((folder / "settings.json").read_text())
    later, other = (home.run_folder(f"{name}-v0", "later") for name in ("CartPole", "Acrobot"))
    with RunContext(home, server.uri).offline() as driver:
        with driver.session(folder, "CartPole-v0", settings) as first:
            server.kill()
            with driver.session(later, "CartPole-v0", {}) as second:
                assert second.tracker is first.tracker
        missing = pytest.raises(InvalidInput, match="no MLflow server")
        with missing, driver.session(other, "Acrobot-v0", {}):
            pass
    server.start()


def test_an_interruption_is_logged_once(
    home: Home, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The inner run knows how little is lost."""
    with (
        RunContext(home, home.database_uri).offline() as driver,
        driver.session(home.run_folder("CartPole-v0", "outer"), "CartPole-v0", {}) as outer,
        driver.session(folder, "CartPole-v0", {}) as inner,
        pytest.raises(KeyboardInterrupt),
        outer.live(StudyViews(folder), 1, "resume the outer run"),
        inner.live(StudyViews(folder), 1, "resume the inner run"),
    ):
        raise KeyboardInterrupt
    lines = re.findall("interrupted; .*", capsys.readouterr().out)
    assert lines == ["interrupted; resume the inner run"]


def test_the_mirror_waits_for_a_locked_database(home: Home, folder: Path) -> None:
    log: list[str] = []
    mirror, keys = mirror_of(folder, home.database_uri, log.append)
    lock = sqlite3.connect(home.folder / "mlflow.db")
    lock.execute("BEGIN EXCLUSIVE")
    mirror.mark(keys)
    wait_for(lambda: bool(log))
    assert "database is locked" in log[0]
    lock.rollback()
    lock.close()
    assert mirror.close() == 0
    assert disagreements(folder, home.database_uri) == []
