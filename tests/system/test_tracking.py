"""MLflow is a view of the disk: it may be unreachable, locked, empty or out of date."""

import json
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import mlflow
import numpy as np
import pytest
from mlflow.store.tracking.dbmodels.models import SqlExperimentTag
from sqlalchemy import event
from sqlalchemy.orm import Session

from bilevel import InvalidInput
from bilevel.nes.checkpoint import save_state
from bilevel.synthetic_env import SE, load_se
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import Journal
from cluster.bohb.view import StudyViews
from cluster.catalog.kinds import views_of
from cluster.catalog.sync import sync
from cluster.nes.selection import FinalScore, export_best
from cluster.session.context import RunContext
from cluster.session.session import shown_at
from cluster.session.terminal import Terminal
from cluster.storage.home import Home
from cluster.storage.run_folder import BEST_FILE, RunIdentity, held
from cluster.tracking import Mirror, Tracker
from cluster.tracking.connection import _IMPORT
from cluster.tracking.tracker import KEY
from cluster.tracking.view import Document, RunView
from tests.mlflow_shown import Server, disagreements
from tests.studies import make_study

pytestmark = pytest.mark.timeout(120)


@pytest.fixture
def new_home(tmp_path: Path) -> Home:
    """A home without a database."""
    home = Home(tmp_path / "home")
    home.prepare()
    return home


@pytest.fixture
def home(new_home: Home, database: Path) -> Home:
    shutil.copy(database, new_home.folder)
    return new_home


@pytest.fixture
def folder(home: Home) -> Path:
    folder = home.run_folder("CartPole-v0", "made")
    make_study(folder, fail=(1,))
    return folder


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, database: Path) -> Iterator[Server]:
    """A server that each test leaves running; every study has its own identity."""
    with Server(tmp_path_factory.mktemp("server"), empty=database) as server:
        yield server


def test_another_database_is_told_by_its_name(
    home: Home, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A relative one lies in the current folder; `bilevel ui` would show the home's instead."""
    monkeypatch.chdir(tmp_path)
    tracker = Tracker("sqlite:///mine.db", "CartPole-v0", home.artifacts)
    assert (tmp_path / "mine.db").exists()
    assert shown_at(home, tracker) == f"sqlite:///mine.db, experiment {tracker.experiment_id}"
    tracker = Tracker(home.database_uri, "CartPole-v0", home.artifacts)
    told = shown_at(home, tracker)
    assert told.startswith(f"http://127.0.0.1:5000/#/experiments/{tracker.experiment_id}/runs?")
    assert "ui" in told


def until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not true():
        assert time.monotonic() < deadline, "it does not come about"
        time.sleep(0.05)


def test_sync_rebuilds_a_study_in_an_empty_database(home: Home, folder: Path) -> None:
    sync(folder, home, home.database_uri, Terminal())
    assert disagreements(folder, home.database_uri) == []
    client = mlflow.MlflowClient(home.database_uri, registry_uri=home.database_uri)
    best = client.get_model_version_by_alias("SE-CartPole-v0", "best")
    (failed,) = client.search_runs(["1"], "attributes.status = 'FAILED'")
    assert failed.data.tags["bilevel.error"] == "ValueError: made to fail"
    (parent,) = client.search_runs(["1"], "tags.`bilevel.kind` = 'study'")
    assert best.run_id == parent.info.run_id

    sync(folder, home, home.database_uri, Terminal())  # once more: nothing is there twice
    assert disagreements(folder, home.database_uri) == []
    assert len(client.search_model_versions("name = 'SE-CartPole-v0'")) == 1


def test_the_first_runs_of_a_home_may_start_at_once(new_home: Home) -> None:
    """MLflow creates the tables of a new database without a lock; two at once would fail."""
    go = new_home.folder / "go"
    code = (
        "import pathlib, sys, time, mlflow.store.tracking.sqlalchemy_store;"
        "from cluster.storage.home import Home; from cluster.tracking import Tracker;"
        "home = Home(pathlib.Path(sys.argv[1])); print('ready', flush=True);"
        "[time.sleep(0.001) for _ in iter((home.folder / 'go').exists, True)];"
        "Tracker(home.database_uri, 'CartPole-v0', home.artifacts)"
    )
    command = [sys.executable, "-W", "ignore", "-c", code, str(new_home.folder)]
    processes = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    go.touch()
    for process in processes:
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors


def test_two_first_runs_may_describe_an_experiment_at_once(home: Home) -> None:
    """MLflow looks whether a tag is there and then adds it: another may have added it between."""
    there = {"selectedColumns": ["params.`theirs`"]}

    def add_first(session: Session, *_: object) -> None:
        for tag in session.new:
            if isinstance(tag, SqlExperimentTag) and tag.key.startswith("mlflow.sharedViewState"):
                row = (tag.key, json.dumps(there), tag.experiment_id)
                with closing(sqlite3.connect(home.database)) as database, database:
                    database.execute(
                        "INSERT INTO experiment_tags (key, value, experiment_id) VALUES (?, ?, ?)",
                        row,
                    )

    event.listen(Session, "before_flush", add_first)
    try:
        tracker = Tracker(home.database_uri, "CartPole-v0", home.artifacts)
    finally:
        event.remove(Session, "before_flush", add_first)
    tags = mlflow.MlflowClient(home.database_uri).get_experiment(tracker.experiment_id).tags
    (view,) = [json.loads(tags[key]) for key in tags if key.startswith("mlflow.sharedViewState")]
    assert view["selectedColumns"][0] == "params.`theirs`"
    assert "metrics.`objective`" in view["selectedColumns"]


def test_whoever_uses_mlflow_waits_until_it_is_imported(new_home: Home) -> None:
    """A command that joins a cluster may need MLflow while a thread still imports it: two imports
    at once see incomplete modules of SQLAlchemy."""
    arguments = new_home.database_uri, "CartPole-v0", new_home.artifacts
    user = threading.Thread(target=Tracker, args=arguments)
    with _IMPORT:  # as the importing thread holds it
        user.start()
        user.join(6.0)
        assert user.is_alive()
        assert not (new_home.folder / "mlflow.db").exists()
    user.join(60.0)
    assert (new_home.folder / "mlflow.db").exists()


def test_a_first_run_killed_while_the_database_is_made_leaves_the_next_one_a_whole_one(
    new_home: Home,
) -> None:
    code = (
        "import os, signal, sys, pathlib, alembic.command;"
        "alembic.command.upgrade = lambda *_: os.kill(os.getpid(), signal.SIGKILL);"
        "from cluster.storage.home import Home; from cluster.tracking import Tracker;"
        "home = Home(pathlib.Path(sys.argv[1]));"
        "Tracker(home.database_uri, 'CartPole-v0', home.artifacts)"
    )
    command = [sys.executable, "-W", "ignore", "-c", code, str(new_home.folder)]
    # The tables exist, but later migrations are missing.
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    Tracker(new_home.database_uri, "CartPole-v0", new_home.artifacts)


def test_sync_adds_what_is_missing_and_removes_a_twin(home: Home, folder: Path) -> None:
    views = views_of(folder)
    parent, child, *_ = views.keys()
    tracker = Tracker(home.database_uri, "CartPole-v0", home.artifacts)
    tracker.show(views.view(parent))
    tracker.show(views.view(child))
    client = mlflow.MlflowClient(home.database_uri)
    twin = client.create_run("1", tags={KEY: child})  # whose answer came too late
    client.log_metric(twin.info.run_id, "score_mean", 1.0, step=0)
    assert disagreements(folder, home.database_uri) != []
    sync(folder, home, home.database_uri, Terminal())
    assert disagreements(folder, home.database_uri) == []


def test_a_configuration_that_was_run_again_replaces_what_mlflow_has(
    home: Home, folder: Path
) -> None:
    """After a damaged checkpoint the scores are the same, but the times differ."""
    sync(folder, home, home.database_uri, Terminal())
    path = min(folder.glob("configurations/*/run-0/state.safetensors"))
    journal = Journal(folder)
    line = min(journal.configs, key=lambda line: line.id)
    state = Study.read(folder).run(line.id, line.configuration, 0).load()
    assert state is not None
    later = tuple(replace(r, finished=r.finished + 9, generation_seconds=7) for r in state.records)
    save_state(replace(state, records=later), path)
    assert disagreements(folder, home.database_uri) != []
    sync(folder, home, home.database_uri, Terminal())
    assert disagreements(folder, home.database_uri) == []


@pytest.mark.parametrize(("score", "best"), [(100.0, "newer"), (101.0, "newer"), (99.0, "made")])
def test_aliases_of_the_best_and_the_newest_se(
    home: Home, folder: Path, score: float, best: str
) -> None:
    """Whatever the order in which they are registered."""
    newer = home.run_folder("CartPole-v0", "newer")
    make_study(newer, score=score)
    for study in (newer, folder):
        sync(study, home, home.database_uri, Terminal())
    client = mlflow.MlflowClient(home.database_uri, registry_uri=home.database_uri)
    assert len(client.search_model_versions("name = 'SE-CartPole-v0'")) == 2
    for alias, name in (("best", best), ("newest", "newer")):
        version = client.get_model_version_by_alias("SE-CartPole-v0", alias)
        assert client.get_run(version.run_id or "").info.run_name == name


def test_another_best_se_without_another_result(home: Home, folder: Path) -> None:
    """As of a study all of whose jobs were still under way: the newest version is the new SE."""
    sync(folder, home, home.database_uri, Terminal())
    made, number = load_se(folder / BEST_FILE), len(Journal(folder).results)
    other = replace(made, se=SE(made.architecture, made.psi + np.float32(1)))
    final = FinalScore(np.array([90.0]), np.array([7]), 195.0)
    export_best(other, final, folder, number, 1000, 0)
    for _ in range(2):
        sync(folder, home, home.database_uri, Terminal())
    client = mlflow.MlflowClient(home.database_uri, registry_uri=home.database_uri)
    newest = client.get_model_version_by_alias("SE-CartPole-v0", "newest")
    assert newest.tags["final_score_mean"] == "90"
    history = client.get_metric_history(newest.run_id or "", "final_score_mean")
    assert [(one.step, one.value) for one in history] == [(number, 100.0), (number, 90.0)]


def _broken() -> bytes:
    raise ValueError("broken")


def test_sync_goes_on_after_a_run_that_mlflow_does_not_take(
    home: Home, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    keys = views_of(folder).keys()
    view = StudyViews.view

    def spoiled(self: StudyViews, key: str) -> RunView:
        """One run has a parameter that MLflow's rules forbid, another a picture that fails."""
        made = view(self, key)
        if key == keys[1]:
            return replace(made, params={"a|b": 1})
        if key == keys[2]:
            return replace(made, documents=(Document("broken.png", "1", _broken),))
        return made

    monkeypatch.setattr(StudyViews, "view", spoiled)
    with pytest.raises(InvalidInput, match="lacks 2 runs of 'made', or parts of them"):
        sync(folder, home, home.database_uri, Terminal())
    told = capsys.readouterr().out
    assert "MLflow does not take the run (" in told
    assert "MLflow lacks broken.png" in told
    assert f"{len(keys) - 2} of {len(keys)} runs in MLflow now match the disk" in told
    shown = {
        run.data.tags[KEY] for run in mlflow.MlflowClient(home.database_uri).search_runs(["1"])
    }
    assert set(keys) - {keys[1]} <= shown


def test_a_study_with_damaged_settings_is_refused_in_one_line(home: Home, folder: Path) -> None:
    settings = json.loads((folder / "settings.json").read_text())
    damages: tuple[tuple[str, object], ...] = (("task", None), ("task", {}), ("kind", 3))
    for name, value in (*damages, ("kind", "evaluate"), ("base", 1)):
        (folder / "settings.json").write_text(json.dumps({**settings, name: value}))
        with pytest.raises(InvalidInput, match=r"^[^\n]+$"):
            sync(folder, home, home.database_uri, Terminal())


def test_sync_leaves_a_study_alone_that_is_being_run(home: Home, folder: Path) -> None:
    with held(folder), pytest.raises(InvalidInput, match="being run by another process"):
        sync(folder, home, home.database_uri, Terminal())


def mirror_of(folder: Path, tracker: Tracker, told: list[str]) -> tuple[Mirror, list[str]]:
    views = StudyViews.of(folder)
    assert views.identity == RunIdentity.read(folder)
    return Mirror(tracker, views.view, told.append), views.keys()


def test_a_server_killed_and_started_again_has_everything_once(
    home: Home, folder: Path, server: Server
) -> None:
    told: list[str] = []
    tracker = Tracker(server.uri, "CartPole-v0", home.artifacts)
    mirror, keys = mirror_of(folder, tracker, told)
    mirror.mark(keys[:2])
    until(lambda: keys[0] in tracker._shown)
    time.sleep(0.1)  # in the middle of the next one
    server.kill()
    mirror.mark(keys)
    until(lambda: bool(told))
    assert f"MLflow at {server.uri} is unreachable" in told[0]
    assert "\n" not in told[0]
    server.start()
    until(lambda: len(told) > 1)
    assert told[1] == "MLflow is reachable again and catches up"
    assert mirror.close() == 0
    assert disagreements(folder, server.uri) == []
    assert len(told) == 2


def test_what_a_server_lacks_in_the_end_is_told_and_synced_later(
    home: Home, folder: Path, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cluster.tracking.mirror._PATIENCE_AWAY", 1.0)
    mirror, keys = mirror_of(folder, Tracker(server.uri, "CartPole-v0", home.artifacts), [])
    server.kill()
    mirror.mark(keys)
    assert mirror.close() == len(keys)
    server.start()
    sync(folder, home, server.uri, Terminal())
    assert disagreements(folder, server.uri) == []


@pytest.mark.parametrize("given", [True, False])
def test_how_to_write_it_later_is_told_with_the_mlflow_that_was_given(
    given: bool,
    home: Home,
    folder: Path,
    server: Server,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("cluster.tracking.mirror._PATIENCE_AWAY", 1.0)
    settings = json.loads((folder / "settings.json").read_text())
    context = RunContext(home, server.uri, tracking_given=given)
    with context.offline() as driver, driver.session(folder, "CartPole-v0", settings) as session:
        server.kill()
        with session.live(StudyViews.of(folder), 1, "resume it"):
            pass
    server.start()
    (told,) = re.findall(
        r"once it is reachable, `(.*)` writes", " ".join(capsys.readouterr().out.split())
    )
    option = f" --tracking-uri {server.uri}" if given else ""
    assert told.endswith(f" sync CartPole-v0/made{option} --home {home.folder}")


def test_a_commands_later_runs_begin_while_mlflow_is_away(
    home: Home, folder: Path, server: Server
) -> None:
    """As an experiment's NES runs, of which each has a session of its own."""
    settings = json.loads((folder / "settings.json").read_text())
    later, other = (home.run_folder(f"{name}-v0", "later") for name in ("CartPole", "Acrobot"))
    with RunContext(home, server.uri).offline() as driver:
        with driver.session(folder, "CartPole-v0", settings) as first:
            server.kill()
            with driver.session(later, "CartPole-v0", {}) as second:
                assert second.tracker.experiment_id == first.tracker.experiment_id
                assert second.tracker._shown is not first.tracker._shown
        missing = pytest.raises(InvalidInput, match="no MLflow server")
        with missing, driver.session(other, "Acrobot-v0", {}):
            pass
    server.start()


def test_an_interruption_is_told_once(
    home: Home, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the innermost run, which knows how little is lost."""
    with (
        RunContext(home, home.database_uri).offline() as driver,
        driver.session(home.run_folder("CartPole-v0", "outer"), "CartPole-v0", {}) as outer,
        driver.session(folder, "CartPole-v0", {}) as inner,
        pytest.raises(KeyboardInterrupt),
        outer.live(StudyViews.of(folder), 1, "resume the outer run"),
        inner.live(StudyViews.of(folder), 1, "resume the inner run"),
    ):
        raise KeyboardInterrupt
    told = capsys.readouterr().out
    assert re.findall("interrupted; .*", told) == ["interrupted; resume the inner run"]


def test_a_locked_database_is_waited_for(home: Home, folder: Path) -> None:
    told: list[str] = []
    tracker = Tracker(home.database_uri, "CartPole-v0", home.artifacts)
    lock = sqlite3.connect(home.folder / "mlflow.db")
    lock.execute("BEGIN EXCLUSIVE")
    mirror, keys = mirror_of(folder, tracker, told)
    mirror.mark(keys)
    until(lambda: bool(told))
    assert "database is locked" in told[0]
    assert next(iter(mirror._marked)) == keys[0]  # still before its children
    lock.rollback()
    lock.close()
    assert mirror.close() == 0
    assert disagreements(folder, home.database_uri) == []


def test_a_view_that_cannot_be_made_does_not_hold_up_the_others(home: Home, folder: Path) -> None:
    told: list[str] = []
    mirror, keys = mirror_of(
        folder, Tracker(home.database_uri, "CartPole-v0", home.artifacts), told
    )
    mirror.mark([f"{keys[0]}/nobody", *keys])
    assert mirror.close() == 0
    assert told == [f"study 'made' has no run {keys[0]}/nobody; MLflow does not show it"]
    assert disagreements(folder, home.database_uri) == []
