"""Frozen dataclasses whose fields pydantic validates on construction."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import get_annotations
from typing import Any, TypeVar, cast, dataclass_transform

from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass

from bilevel.decode import reason
from bilevel.errors import InvalidInput

_T = TypeVar("_T")
_Number = TypeVar("_Number", int, float)

#: A bool is not an int, an int is accepted as a float, and unknown fields are errors.
_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(Field,))
def hyperparameters(cls: type[_T]) -> type[_T]:
    """Make a class a frozen dataclass with keyword-only, validated fields.

    A range is written `Annotated[int, Field(ge=1, le=9)]`, a choice is a `Literal`;
    `__post_init__` may check more. An invalid value raises InvalidInput with the name of the field.
    Raises InvalidInput for a class attribute without a type, which would change no field.
    """
    inherited = {field.name for field in fields(cls)} if is_dataclass(cls) else set()
    for name in sorted((inherited & vars(cls).keys()) - get_annotations(cls).keys()):
        raise InvalidInput(f"{cls.__name__}.{name} needs a type annotation to be a field")
    checked: Any = dataclass(frozen=True, kw_only=True, config=_STRICT)(cls)
    build: Callable[..., None] = checked.__init__
    section = getattr(cls, "agent", "") or cls.__name__.removesuffix("Hyperparameters").lower()

    @wraps(build)
    def init(self: Any, /, **values: Any) -> None:
        try:
            build(self, **values)
        except ValidationError as error:
            raise InvalidInput(reason(error, section)) from None

    checked.__init__ = init
    return cast("type[_T]", checked)


def within_range(cls: type, name: str, value: _Number) -> _Number:
    """Clip a value to the range (`ge`, `le`) of that field of a class."""
    for rule in cls.__pydantic_fields__[name].metadata:  # type: ignore[attr-defined]
        value = max(value, getattr(rule, "ge", value))
        value = min(value, getattr(rule, "le", value))
    return value
