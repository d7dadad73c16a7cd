"""Validation of JSON values against the types of a dataclass's fields."""

import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from bilevel.errors import InvalidInput

_T = TypeVar("_T")

_adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)


def decode(kind: type[_T], value: Any, what: str) -> _T:
    """Decode a value, as the json module returns it, as `kind`.

    Validation is strict, except that an int is accepted as a float. Raises InvalidInput for
    invalid, missing and unknown fields, in one line that starts with `what`.
    """
    try:
        # Strict validation accepts a list for a tuple only in JSON text.
        text = json.dumps(value)
    except (ValueError, TypeError, RecursionError) as error:
        raise InvalidInput(f"{what}: {error}") from None
    return decode_json(kind, text, what)


def decode_json(kind: type[_T], text: str | bytes, what: str) -> _T:
    """Decode JSON text as `kind`, like `decode`. Raises InvalidInput also for other text."""
    try:
        decoded: _T = _adapter(kind).validate_json(text, strict=True, extra="forbid")
        return decoded
    except ValidationError as error:
        raise InvalidInput(f"{what}: {reason(error)}") from None


def decode_file(kind: type[_T], path: Path, what: str = "damaged") -> _T:
    """Decode a JSON file as `kind`. Raises InvalidInput, with the path after `what`."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InvalidInput(f"cannot read {str(path)!r}: {error.strerror}") from None
    return decode_json(kind, text, f"{what} {str(path)!r}")


def reason(error: ValidationError, section: str = "") -> str:
    """Describe the first error in one line, with the names of its fields after `section`."""
    # Unknown names first: they are often misspelled missing names.
    errors = error.errors(include_url=False)
    first = min(errors, key=lambda error: error["type"] != "unexpected_keyword_argument")
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"])
    place = (section + "".join(parts)).removeprefix(".")
    match first["type"]:
        case "missing":
            message = f"{place!r} is missing"
        case "unexpected_keyword_argument":
            message = f"unknown {place!r}"
        case "value_error":  # raised by a custom check, whose message is complete
            message = str(first["ctx"]["error"])
        case "json_invalid":
            message = first["msg"]
        case _:
            rule = first["msg"].replace("Input should", "must")
            message = f"{place + ': ' if place else ''}{rule}; got {first['input']!r:.80}"
    return " ".join(message.split())


def differences(then: Any, now: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield the dotted name and both values of every difference between nested settings."""
    if isinstance(then, dict) and isinstance(now, dict):
        for key in dict.fromkeys([*then, *now]):
            place = f"{name}.{key}" if name else key
            yield from differences(then.get(key), now.get(key), place)
    elif then != now:
        yield name, then, now
