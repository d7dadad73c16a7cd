"""JSON lines files, and the journal of a study, under every kind of damage."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bilevel import InvalidInput
from cluster.bohb.study.journal import ConfigLine, Journal, ResultLine
from cluster.storage.jsonl_log import JsonlLog
from tests.small_disk import on_small_disk, small_disks

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=12,
)

STAMPS = {"submitted": 1.0, "started": 1.0, "finished": 2.0}


def write_journal(folder: Path) -> None:
    """Write three configurations and two results."""
    journal = Journal(folder)
    for number in range(3):
        journal.add_config(ConfigLine((0, 0, number), {"nes.step_size": 0.1}, {}))
    journal.add_result(ResultLine((0, 0, 0), 1, -12.5, {}, STAMPS))
    journal.add_result(ResultLine((0, 0, 1), 1, None, {}, STAMPS, "it failed"))


@given(values=st.lists(json_values.filter(lambda v: v == v), max_size=5), cut=st.integers(0, 40))
@settings(max_examples=60)
def test_complete_lines_survive_a_cut(
    values: list[Any], cut: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("lines") / "file"
    for value in values:
        JsonlLog(path).append(value)
    content = path.read_bytes() if values else b""
    kept = content[: max(len(content) - cut, 0)]
    path.write_bytes(kept)
    complete = [json.loads(line) for line in kept.split(b"\n")[:-1]]
    log = JsonlLog(path)
    assert repr(log.values) == repr(complete)
    assert path.read_bytes() == kept
    log.append("next")
    assert repr(JsonlLog(path).values) == repr([*complete, "next"])


@pytest.mark.parametrize(
    ("name", "line", "message"),
    [
        ("results.json", "[[0, 0, 2]]", "line 3: '[1]' is missing"),
        (
            "results.json",
            json.dumps([[0, 0, 2], 1, STAMPS, {"loss": float("nan"), "info": {}}, None]),
            "line 3: [3].loss: must be a finite number; got nan",
        ),
        ("configs.json", '["../..", {}, {}]', "line 4: [0]: must be a valid array; got '../..'"),
        ("configs.json", "[" * 100_000, "line 4: "),
    ],
)
def test_messages_name_the_damaged_line(name: str, line: str, message: str, tmp_path: Path) -> None:
    write_journal(tmp_path)
    with (tmp_path / name).open("a") as file:
        file.write(line + "\n")
    with pytest.raises(InvalidInput) as caught:
        Journal(tmp_path)
    assert f"{name}', {message}" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not small_disks(), reason="no small disk can be mounted here")
def test_a_full_disk_adds_nothing(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    script = f"""{sys.executable} - <<'END'
from pathlib import Path
from bilevel.errors import StorageFailure
from cluster.storage.jsonl_log import JsonlLog
log = JsonlLog(Path({str(disk)!r}) / "file")
log.append("first")
try:
    log.append("x" * 100_000)
except StorageFailure as failure:
    print(failure)
assert JsonlLog(log.path).values == log.values == ["first"]
log.append("second")
assert JsonlLog(log.path).values == ["first", "second"]
END"""
    result = on_small_disk(disk, "64k", script)
    assert result.returncode == 0, result.stderr
    assert result.stdout == f"cannot write '{disk}/file': No space left on device\n"
