"""A study's CSV files, and its folder as other tools read it."""

import csv
import io
import json
from pathlib import Path

import ConfigSpace as CS

from cluster.bohb.results.summary import StudySummary
from cluster.bohb.results.tables import leaders_csv, results_csv
from cluster.bohb.study.definition import SPACE_FILE
from cluster.bohb.study.journal import Journal
from tests.studies import make_study


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_all_results_with_their_configurations(tmp_path: Path) -> None:
    study = make_study(tmp_path, fail=(1,))
    journal = Journal(tmp_path)
    summary = StudySummary(journal, study.schedule.brackets(2))
    found = rows(results_csv(summary))
    assert len(found) == len(journal.results)
    for row, line in zip(found, journal.results, strict=True):
        config = next(c for c in journal.configs if c.id == line.id)
        assert int(row["budget"]) == line.budget
        assert row["objective"] == ("" if line.loss is None else str(line.loss))
        assert row["origin"] == config.origin
        assert 0 <= float(row["started"]) <= float(row["finished"])
        for name, value in config.configuration.items():
            assert row[name] == str(value)
    assert [row["objective"] for row in found].count("") == 1
    best = rows(leaders_csv(summary))[-1]
    assert summary.incumbent is not None
    assert float(best["objective"]) == summary.incumbent.loss


def test_of_no_results(tmp_path: Path) -> None:
    study = make_study(tmp_path / "study")
    summary = StudySummary(Journal(tmp_path), study.schedule.brackets(1))
    assert rows(results_csv(summary)) == rows(leaders_csv(summary)) == []


def test_the_space_beside_the_journal(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    study.write_space()
    space = CS.ConfigurationSpace.from_serialized_dict(
        json.loads((tmp_path / SPACE_FILE).read_text())
    )
    assert space == study.space.build(study.agents)
    for line in Journal(tmp_path).configs:
        CS.Configuration(space, values=dict(line.configuration))  # raises for one that is not in it
