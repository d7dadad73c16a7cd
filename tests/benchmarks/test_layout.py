from pathlib import Path

import pytest

from benchmarks.layout import from_the_top, rooms


def test_rooms_and_arrows_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package whose bottom room imports its top."""
    package = tmp_path / "house_of_three"
    (package / "middle").mkdir(parents=True)
    for path, code in {
        "__init__.py": "",
        "top.py": "from house_of_three import bottom\nfrom house_of_three.middle import inner\n",
        "middle/__init__.py": "",
        "middle/inner.py": "from house_of_three import bottom\n",
        "bottom.py": "def late() -> None:\n    import house_of_three.top\n",
    }.items():
        (package / path).write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    found = rooms(package.name)
    assert found["rooms"] == 3
    assert found["arrows"] == 4
    assert found["back up"] == 1
    assert found["arrows back up"] == [["bottom", "top"]]
    assert from_the_top(found["drawing"], [("bottom", "top")]) == ["top", "middle", "bottom"]
