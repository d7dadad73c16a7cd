"""Values from outside, decoded by their types: the fields of a dataclass and what each may be."""

import json
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from bilevel.errors import InvalidInput

_T = TypeVar("_T")

#: What decodes a type; made when the first value of that type comes.
_adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)

#: Characters of a wrong value that a message tells.
_TOLD = 80


def decode(kind: type[_T], value: Any, what: str) -> _T:
    """A value that JSON holds, as read by `json`, as that type.

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
    """The same of JSON itself; other text is an InvalidInput too."""
    try:
        decoded: _T = _adapter(kind).validate_json(text, strict=True, extra="forbid")
        return decoded
    except ValidationError as error:
        raise InvalidInput(f"{what}: {reason(error)}") from None


def reason(error: ValidationError) -> str:
    """The first thing that is wrong, in one line."""
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"])
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
            told = f"{place + ': ' if place else ''}{first['msg']}; got {given}"
    return " ".join(told.split())
