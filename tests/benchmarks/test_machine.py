from pathlib import Path

import pytest

from benchmarks import machine
from benchmarks.machine import (
    NotMeasured,
    read_result,
    require_as_many,
    require_seeds,
    resumed_result,
    resumed_runs,
    spread,
    write_result,
)
from cluster.storage.author import commit


def test_results_are_read_as_they_were_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path / "results")
    values = {"runs": [{"scores": [1.5, 2.0], "seed": 3}]}
    path = write_result("name", "python -m it", values)
    assert '"scores": [ 1.5, 2.0 ]' in path.read_text()
    told = read_result("name", "runs")
    assert told["runs"] == values["runs"]
    assert told["command"] == "python -m it"
    assert told["machine"]["cores"] >= 1
    assert told["commit"] == commit()
    for missing in (("other",), ("name", "rows")):
        with pytest.raises(NotMeasured, match=missing[0]):
            read_result(*missing)


def test_a_result_of_several_sittings_names_the_commits_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path)
    for now in ("one", "two", "two", "three"):
        monkeypatch.setattr(machine, "commit", lambda now=now: now)
        write_result("name", "measure", {"runs": []}, resumed=True)
    told = read_result("name")
    assert (told["commit"], told["earlier_commits"]) == ("three", ["one", "two"])
    (tmp_path / "name.json").write_text('{"command": "measure", "runs": []}')
    write_result("name", "measure", {"runs": []}, resumed=True)
    assert "earlier_commits" not in read_result("name")
    write_result("name", "measure", {"runs": []})  # all of it anew
    assert "earlier_commits" not in read_result("name")


def test_spread_is_median_and_range() -> None:
    assert spread([4.0, 1.0, 2.0]) == {"median": 2.0, "low": 1.0, "high": 4.0}
    assert spread([12345.6, 0.072768]) == {"median": 6173.0, "low": 0.07277, "high": 12350.0}


def test_results_of_other_options_or_seeds_are_not_mixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path)
    command, growing = "measure Task --seeds {} --taught {} --agents {} --home FOLDER", ("seeds",)
    assert resumed_result("name", command.format("0-1", 2, 6), growing) == {}
    write_result("name", command.format("0-1", 2, 6), {"runs": [{"seed": 0}, {"seed": 1}]})
    more = command.format("0-3", 2, 6)
    assert resumed_runs("name", more, growing, range(4)) == [{"seed": 0}, {"seed": 1}]
    for other in (command.format("0-1", 2, 7), command.format("0-1", 3, 6)):
        with pytest.raises(SystemExit, match=r"name.json was measured by 'measure .*: give"):
            resumed_result("name", other, growing)
    taught = ("seeds", "taught")
    assert len(resumed_result("name", command.format("0-1", 3, 6), taught)["runs"]) == 2
    with pytest.raises(SystemExit, match="has the seeds 0, too: add them to --seeds"):
        resumed_runs("name", command.format("1-3", 2, 6), growing, range(1, 4))


def test_a_command_does_not_tell_of_less_than_was_measured() -> None:
    require_as_many("search", "--fresh", 5, 5)
    require_as_many("search", "--fresh", 5, 6)
    with pytest.raises(SystemExit, match=r"search.json was measured with --fresh 5: give that or"):
        require_as_many("search", "--fresh", 5, 4)
    require_seeds("search", {1, 2}, [1, 2, 3])
    with pytest.raises(SystemExit, match=r"search.json has the seeds 3, too: add them"):
        require_seeds("search", {1, 3}, [1, 2])
