import io
import json
import re
from pathlib import Path

import pytest
from rich.console import Console

from cluster.bohb.study.profiles import ENDLESS
from cluster.catalog.overview import overview, print_overview
from cluster.storage.home import Home
from cluster.storage.run_folder import RunStatus, held
from tests.studies import make_study, new_study


@pytest.fixture
def home(tmp_path: Path) -> Home:
    return Home(tmp_path)


def test_nothing_yet(home: Home) -> None:
    assert overview(home) == []


def test_states_progress_and_scores(home: Home) -> None:
    for name in ("ended", "stopped", "killed", "running"):
        make_study(home.run_folder("CartPole-v0", name))
    RunStatus("KILLED", 0.0, 4).save(home.run_folder("CartPole-v0", "stopped"))
    for name in ("killed", "running"):
        RunStatus("RUNNING", 0.0, 2).save(home.run_folder("CartPole-v0", name))
    with held(home.run_folder("CartPole-v0", "running")):
        lines = {line.name: line for line in overview(home)}
    assert {name: line.state for name, line in lines.items()} == {
        "ended": "finished",
        "stopped": "stopped",
        "killed": "killed",
        "running": "running",
    }
    assert lines["ended"].progress == "6/6 results"
    assert lines["stopped"].progress == "6/12 results"
    RunStatus("KILLED", 0.0, ENDLESS).save(home.run_folder("CartPole-v0", "stopped"))
    assert {line.name: line for line in overview(home)}["stopped"].progress == "6 results"
    assert lines["ended"].final == "100.0"
    assert re.fullmatch(r"\d+ core s", lines["ended"].best)


def test_a_damaged_study_is_listed_as_such(home: Home) -> None:
    folder = home.run_folder("CartPole-v0", "broken")
    make_study(folder)
    (folder / "results.json").write_text("nonsense\n")
    (line,) = overview(home)
    assert line.state == "damaged"
    assert "results.json', line 1" in line.fault
    out = io.StringIO()
    print_overview([line], Console(file=out, width=40, soft_wrap=True))
    *_, told, advice = out.getvalue().splitlines()
    assert told == f"CartPole-v0/broken: {line.fault}"
    assert "no more than its command again" in advice
    assert "Bring other damaged files back" in advice


def test_a_study_of_another_format_is_listed_as_such(home: Home) -> None:
    folder = home.run_folder("CartPole-v0", "ancient")
    make_study(folder)
    settings = json.loads((folder / "settings.json").read_text())
    (folder / "settings.json").write_text(json.dumps({**settings, "format": 1}))
    (line,) = overview(home)
    assert line.state == "old"
    assert "'ancient' has format 1" in line.fault


def test_table(home: Home, capsys: pytest.CaptureFixture[str]) -> None:
    make_study(home.run_folder("CartPole-v0", "one"))
    print_overview(overview(home), Console(width=100))
    header, line = capsys.readouterr().out.splitlines()
    assert header.split() == ["task", "name", "kind", "state", "progress", "best", "final"]
    assert line.split()[:6] == ["CartPole-v0", "one", "study", "finished", "6/6", "results"]


def test_a_study_is_read_as_it_was_begun(home: Home) -> None:
    from cluster.bohb.study.definition import Study

    folder = home.run_folder("CartPole-v0", "one")
    make_study(folder)
    assert Study.read(folder) == new_study(folder)


def test_a_narrow_terminal_folds_names_and_cuts_nothing(home: Home) -> None:
    make_study(home.run_folder("CartPole-v0", "a-name-that-is-longer-than-the-terminal-is-wide"))
    out = io.StringIO()
    print_overview(
        overview(home),
        Console(file=out, width=76, force_terminal=True, color_system=None, soft_wrap=True),
    )
    text = out.getvalue()
    for shown in ("finished", "6/6 results", "100.0"):
        assert shown in text
    assert max(len(line) for line in text.splitlines()) <= 76
    assert "\u2026" not in text


def test_a_pipe_gets_whole_lines(home: Home) -> None:
    name = "a-name-that-is-longer-than-the-terminal-is-wide-and-of-the-longest-sort"
    make_study(home.run_folder("CartPole-v0", name))
    out = io.StringIO()
    print_overview(overview(home), Console(file=out, width=40, soft_wrap=True))
    _, line = out.getvalue().splitlines()
    assert line.split()[:4] == ["CartPole-v0", name, "study", "finished"]
