import argparse
from pathlib import Path

import pytest

from benchmarks import machine
from benchmarks.machine import (
    NotMeasured,
    earlier_result,
    format_seeds,
    known_task,
    parse_seeds,
    read_result,
    spread,
    write_result,
)
from cluster.storage.author import commit


@pytest.fixture(autouse=True)
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path / "results")


@pytest.mark.parametrize(
    ("text", "seeds"),
    [("3", [3]), ("0-4,9", [0, 1, 2, 3, 4, 9]), ("7,6", [7, 6]), ("2-3,30-31", [2, 3, 30, 31])],
)
def test_seeds_round_trip(text: str, seeds: list[int]) -> None:
    assert parse_seeds(text) == seeds
    assert format_seeds(seeds) == text


@pytest.mark.parametrize("text", ["", "a", "1-", "-1", "1,,2", "1-2-3"])
def test_invalid_seeds_are_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="a list such as"):
        parse_seeds(text)


def test_an_unknown_task_is_refused() -> None:
    assert known_task("CartPole-v0") == "CartPole-v0"
    with pytest.raises(argparse.ArgumentTypeError, match="unknown task 'CartPole-v9': allowed are"):
        known_task("CartPole-v9")


def test_results_round_trip() -> None:
    values = {"runs": [{"scores": [1.5, 2.0], "seed": 3}]}
    path = write_result("name", "python -m it", values)
    assert '"scores": [ 1.5, 2.0 ]' in path.read_text()
    result = read_result("name", "runs")
    assert result["runs"] == values["runs"]
    assert (result["command"], result["commit"]) == ("python -m it", commit())
    assert result["machine"]["cores"] >= 1
    for missing in (("other",), ("name", "rows")):
        with pytest.raises(NotMeasured, match=missing[0]):
            read_result(*missing)


def test_a_resumed_result_names_all_commits(monkeypatch: pytest.MonkeyPatch) -> None:
    for now in ("one", "two", "two", "three"):
        monkeypatch.setattr(machine, "commit", lambda now=now: now)
        write_result("name", "measure", {"runs": []}, resumed=True)
    result = read_result("name")
    assert (result["commit"], result["earlier_commits"]) == ("three", ["one", "two"])
    write_result("name", "measure", {"runs": []})
    assert "earlier_commits" not in read_result("name")


def test_results_of_other_options_are_not_extended() -> None:
    command, growing = "measure Task --seeds {} --taught {} --agents {} --home FOLDER", ("seeds",)
    assert earlier_result("name", command.format("0-1", 2, 6), growing) == {}
    write_result("name", command.format("0-1", 2, 6), {"runs": [1]})
    assert earlier_result("name", command.format("0-3", 2, 6), growing)["runs"] == [1]
    assert earlier_result("name", command.format("0", 3, 6), ("seeds", "taught"))["runs"] == [1]
    for other in (command.format("0-1", 2, 7), command.format("0-1", 3, 6)):
        with pytest.raises(SystemExit, match=r"name.json was measured by 'measure .*: use its"):
            earlier_result("name", other, growing)


def test_spread_is_median_and_range() -> None:
    assert spread([4.0, 1.0, 2.0]) == {"median": 2.0, "low": 1.0, "high": 4.0}
    assert spread([12345.6, 0.072768]) == {"median": 6173.0, "low": 0.07277, "high": 12350.0}
