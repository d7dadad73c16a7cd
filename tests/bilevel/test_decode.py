"""Decoding of JSON values, and one-line messages for invalid ones."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from bilevel import InvalidInput
from bilevel.decode import decode, decode_file, decode_json


@dataclass(frozen=True)
class Point:
    name: str
    at: tuple[float, ...]
    count: int = 0


def test_lists_become_tuples_and_ints_become_floats() -> None:
    point = decode(Point, {"name": "a", "at": [1, float("-inf")]}, "point")
    assert point == Point("a", (1.0, float("-inf")))
    assert isinstance(point.at[0], float)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": None}, "point: name: must be a valid string; got None"),
        ({"at": [1, True]}, "point: at[1]: must be a valid number; got True"),
        ({"at": "12"}, "point: at: must be a valid array; got '12'"),
        ({"count": 1.0}, "point: count: must be a valid integer; got 1.0"),
        ({"count": True}, "point: count: must be a valid integer; got True"),
        ({"colour\n": "red"}, "point: unknown 'colour\\n'"),
        ({"name": 3 * [100 * "x"]}, f"point: name: must be a valid string; got ['{78 * 'x'}"),
    ],
)
def test_the_message_contains_field_rule_and_value(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        decode(Point, {"name": "a", "at": [], **changes}, "point")
    assert str(caught.value) == message


@pytest.mark.parametrize("value", [None, [], 7, {}, object(), {"name": {1: object()}}])
def test_values_that_are_not_objects(value: object) -> None:
    with pytest.raises(InvalidInput, match=r"^point: [^\n]+$"):
        decode(Point, value, "point")


@pytest.mark.parametrize(
    "text", [b"", b"\xff", b"{", b"nonsense", b"[" * 100_000, b'{"name": "\n"}']
)
def test_text_that_is_not_json(text: bytes, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"^point: Invalid JSON: [^\n]+$"):
        decode_json(Point, text, "point")
    (tmp_path / "file").write_bytes(text)
    with pytest.raises(InvalidInput, match=r"^damaged '.*file': [^\n]+$"):
        decode_file(Point, tmp_path / "file")
    with pytest.raises(InvalidInput, match=r"cannot read '.*none': No such file"):
        decode_file(Point, tmp_path / "none")
