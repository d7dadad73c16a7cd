from pathlib import Path

import pytest

from benchmarks.readme import DOCUMENTS, filled


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_documents_show_the_committed_results(document: Path) -> None:
    text, tables = document.read_text(), DOCUMENTS[document]
    for name in tables:
        assert f"<!-- {name} -->" in text
    assert filled(text, tables) == text, "run `python -m benchmarks.readme`"
