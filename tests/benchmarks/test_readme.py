"""The tables of README and docs are generated from the committed results."""

import json
import re
import shutil
from pathlib import Path

import pytest

from benchmarks import machine
from benchmarks.readme import DOCUMENTS, ROOT, fill


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_tables_are_up_to_date(document: Path) -> None:
    """`python -m benchmarks.readme` writes them."""
    text = document.read_text()
    for name in DOCUMENTS[document]:
        assert text.count(f"<!-- {name} -->") == text.count(f"<!-- /{name} -->") == 1
    assert fill(text, DOCUMENTS[document]) == text


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
    text = fill(readme.read_text(), DOCUMENTS[readme])
    assert "| an agent |" in text
    path.unlink()
    missing = "*Not measured yet: `benchmarks/results/inner_loop.json`*"
    assert missing in fill(text, DOCUMENTS[readme])


def test_committed_results_contain_no_absolute_paths() -> None:
    for path in (ROOT / "benchmarks").rglob("*.json"):
        found = re.findall(r'[" =](/[A-Za-z0-9._-]+)+', path.read_text())
        assert not found, f"{path}: {found[:3]}"
