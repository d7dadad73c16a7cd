"""`bilevel runs`."""

import io
import json
import re
from pathlib import Path

import pytest
from rich.console import Console

from cluster.bohb.study.profiles import ENDLESS
from cluster.catalog import overview, print_overview
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, held
from tests.studies import make_study


@pytest.fixture
def home(tmp_path: Path) -> Home:
    return Home(tmp_path)


def test_an_empty_home_has_no_runs(home: Home) -> None:
    assert overview(home) == []


def test_states_progress_and_scores(home: Home) -> None:
    folders = {name: home.run_folder("CartPole-v0", name) for name in ("a", "b", "c", "d")}
    for folder in folders.values():
        make_study(folder)
    RunStatus("KILLED", 0.0, 4).save(folders["b"])
    for name in ("c", "d"):
        RunStatus("RUNNING", 0.0, 2).save(folders[name])
    with held(folders["d"]):
        finished, stopped, killed, running = overview(home)
    states = [line.state for line in (finished, stopped, killed, running)]
    assert states == ["finished", "stopped", "killed", "running"]
    assert (finished.progress, stopped.progress) == ("6/6 results", "6/12 results")
    assert finished.final == "100.0"
    assert re.fullmatch(r"\d+ core s", finished.best)
    RunStatus("KILLED", 0.0, ENDLESS).save(folders["b"])
    assert overview(home)[1].progress == "6 results"


def test_a_damaged_run_is_listed_with_its_error(home: Home) -> None:
    folder = home.run_folder("CartPole-v0", "broken")
    make_study(folder)
    (folder / "results.json").write_text("nonsense\n")
    (line,) = overview(home)
    assert line.state == "damaged"
    assert "results.json', line 1" in line.fault
    out = io.StringIO()
    print_overview([line], Console(file=out, width=40))
    assert f"CartPole-v0/broken: {line.fault}" in out.getvalue().splitlines()


def test_a_run_of_another_format_is_listed_as_old(home: Home) -> None:
    folder = home.run_folder("CartPole-v0", "ancient")
    make_study(folder)
    settings = json.loads((folder / "settings.json").read_text())
    (folder / "settings.json").write_text(json.dumps({**settings, "format": 99}))
    (line,) = overview(home)
    assert line.state == "old"
    assert "'ancient' has format 99" in line.fault


def test_lines_are_aligned(home: Home) -> None:
    for name in ("a", "a-long-name"):
        make_study(home.run_folder("CartPole-v0", name))
    out = io.StringIO()
    print_overview(overview(home), Console(file=out, width=40))
    header, *lines = out.getvalue().splitlines()
    assert header.split() == ["task", "name", "kind", "state", "progress", "best", "final"]
    for column, value in (("kind", "study"), ("state", "finished"), ("final", "100.0")):
        assert all(line.index(value) == header.index(column) for line in lines)
