from pathlib import Path

import pytest

from benchmarks import machine
from benchmarks.machine import NotMeasured, read_result, spread, write_result


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
    for missing in (("other",), ("name", "rows")):
        with pytest.raises(NotMeasured, match=missing[0]):
            read_result(*missing)


def test_spread_is_median_and_range() -> None:
    assert spread([4.0, 1.0, 2.0]) == {"median": 2.0, "low": 1.0, "high": 4.0}
    assert spread([12345.6, 0.072768]) == {"median": 6173.0, "low": 0.07277, "high": 12350.0}
