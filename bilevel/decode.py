"""Values from outside, decoded by their types: the fields of a dataclass and what each may be."""

import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from bilevel.errors import InvalidInput

_T = TypeVar("_T")

#: What decodes a type; made when the first value of that type comes.
_adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)

#: Characters of a wrong value that a message tells.
_TOLD = 80


def decode(kind: type[_T], value: Any, what: str) -> _T:
    """Decode a value, as `json` reads it, as `kind`.

    An int will do for a float, and that is all. Raises InvalidInput, in one line that begins with
    `what`, for anything else, also for a field that the type does not have.
    """
    try:
        # As text, because only JSON may have a list where the type has a tuple.
        text = json.dumps(value)
    except (ValueError, TypeError, RecursionError) as error:
        raise InvalidInput(f"{what}: {error}") from None
    return decode_json(kind, text, what)


def decode_json(kind: type[_T], text: str | bytes, what: str) -> _T:
    """Decode JSON text as `kind`, as `decode` does; raises InvalidInput also for other text."""
    try:
        decoded: _T = _adapter(kind).validate_json(text, strict=True, extra="forbid")
        return decoded
    except ValidationError as error:
        raise InvalidInput(f"{what}: {reason(error)}") from None


def decode_file(kind: type[_T], path: Path, what: str = "damaged") -> _T:
    """Decode a JSON file as `kind`; messages name the file after `what`. Raises InvalidInput."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InvalidInput(f"cannot read {str(path)!r}: {error.strerror}") from None
    return decode_json(kind, text, f"{what} {str(path)!r}")


def first_fault(error: ValidationError) -> ErrorDetails:
    """The first error; unknown names come before missing ones, which they often stand for."""
    faults = error.errors(include_url=False)
    return min(faults, key=lambda fault: fault["type"] != "unexpected_keyword_argument")


def reason(error: ValidationError) -> str:
    """The first error in one line."""
    first = first_fault(error)
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"])
    place = "".join(parts).removeprefix(".")
    given = repr(first["input"])
    given = given if len(given) <= _TOLD else f"{given[:_TOLD]}..."
    match first["type"]:
        case "missing":
            told = f"{place!r} is missing"
        case "unexpected_keyword_argument":
            told = f"unknown {place!r}"
        case "value_error":  # of a check of one's own, which tells all
            told = str(first["ctx"]["error"])
        case "json_invalid":
            told = first["msg"]
        case _:
            says = first["msg"].replace("Input should", "must")
            told = f"{place + ': ' if place else ''}{says}; got {given}"
    return " ".join(told.split())


def differences(then: Any, now: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Dotted name and both values, wherever nested settings differ."""
    if isinstance(then, dict) and isinstance(now, dict):
        for key in dict.fromkeys([*then, *now]):
            place = f"{name}.{key}" if name else key
            yield from differences(then.get(key), now.get(key), place)
    elif then != now:
        yield name, then, now
