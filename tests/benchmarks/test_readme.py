"""The tables of README and docs are made of the committed results, none by hand."""

import json
import shutil
from pathlib import Path

import pytest

from benchmarks import machine
from benchmarks.readme import DOCUMENTS, ROOT, filled


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_the_tables_are_those_of_the_results(document: Path) -> None:
    """(`python -m benchmarks.readme` writes them.)"""
    text = document.read_text()
    assert filled(text, DOCUMENTS[document]) == text


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_table_has_its_place(document: Path) -> None:
    text = document.read_text()
    for name in DOCUMENTS[document]:
        assert text.count(f"<!-- {name} -->") == text.count(f"<!-- /{name} -->") == 1


def test_another_result_makes_another_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(machine.RESULTS, tmp_path / "results")
    monkeypatch.setattr(machine, "RESULTS", tmp_path / "results")
    path = tmp_path / "results" / "inner_loop.json"
    result = json.loads(path.read_text())
    result["results"] = {"an agent": next(iter(result["results"].values()))}
    path.write_text(json.dumps(result))
    readme = ROOT / "README.md"
    text = filled(readme.read_text(), DOCUMENTS[readme])
    assert "| an agent |" in text
    path.unlink()
    assert "*Not measured yet: `benchmarks/results/inner_loop.json`*" in filled(
        text, DOCUMENTS[readme]
    )
