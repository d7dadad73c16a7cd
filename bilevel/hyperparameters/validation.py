"""Frozen dataclasses whose fields pydantic validates on construction."""

from collections.abc import Callable
from functools import cache, wraps
from inspect import get_annotations
from typing import Any, Literal, TypeVar, cast, dataclass_transform, get_args, get_origin

from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass
from pydantic.fields import FieldInfo

from bilevel.decode import first_fault, reason
from bilevel.errors import InvalidInput, one_of

_T = TypeVar("_T")
_Number = TypeVar("_Number", int, float)

#: A bool is not an int, an int is accepted as a float, and unknown fields are errors.
_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(Field,))
def hyperparameters(cls: type[_T]) -> type[_T]:
    """Make a class a frozen dataclass with keyword-only, validated fields.

    A range is written `Annotated[int, Field(ge=1, le=9)]`, a choice is a `Literal`;
    `__post_init__` may check more. An invalid value raises InvalidInput with the name or title of
    the field. Raises InvalidInput for a class attribute without a type annotation.
    """
    for name, value in vars(cls).items():
        annotated = any(name in get_annotations(base) for base in cls.__mro__)
        if (
            not name.startswith("__")
            and not annotated
            and isinstance(value, bool | int | float | str)
        ):
            raise InvalidInput(
                f"{cls.__name__}.{name} has no type annotation: write, for instance, "
                f"`{name}: Annotated[{type(value).__name__}, Field(...)] = {value!r}`"
            )
    checked: Any = dataclass(frozen=True, kw_only=True, config=_STRICT)(cls)
    build: Callable[..., None] = checked.__init__

    @wraps(build)
    def init(self: Any, /, **values: Any) -> None:
        try:
            build(self, **values)
        except ValidationError as error:
            raise _invalid(checked, error) from None

    checked.__init__ = init
    return cast("type[_T]", checked)


def within_range(cls: type, name: str, value: _Number) -> _Number:
    """Clip a value to the range (`ge`, `le`) of that field of a class."""
    low, high = _range(cls, name)
    value = value if low is None else max(value, low)
    return value if high is None else min(value, high)


@cache  # NES draws agents by the thousand
def _range(cls: type, name: str) -> tuple[Any, Any]:
    field: FieldInfo = cls.__pydantic_fields__[name]  # type: ignore[attr-defined]
    return _end(field, "ge"), _end(field, "le")


def _end(field: FieldInfo, name: str) -> Any:
    return next((getattr(rule, name) for rule in field.metadata if hasattr(rule, name)), None)


def _invalid(cls: Any, error: ValidationError) -> InvalidInput:
    """Return the error for the first invalid value, with the field's name in recipes."""
    first, fields = first_fault(error), cls.__pydantic_fields__
    name = str(next(iter(first["loc"]), ""))
    section = getattr(cls, "agent", "") or cls.__name__.removesuffix("Hyperparameters").lower()
    full = ".".join(filter(None, (section, name)))
    if first["type"] == "unexpected_keyword_argument":
        return one_of("hyperparameter", full, [full.removesuffix(name) + field for field in fields])
    if first["type"] == "missing":
        return InvalidInput(f"{section or cls.__name__}: {reason(error)}")
    if first["type"] == "value_error":  # raised by __post_init__
        return InvalidInput(reason(error))
    field, given = fields[name], first["input"]
    title, kind = field.title or full, field.annotation
    if get_origin(kind) is Literal:
        return one_of(title, given, get_args(kind))
    ends = [_end(field, name) for name in ("ge", "le")]
    if kind is bool:
        allowed = "bool, true or false"
    elif kind in (int, float) and None not in ends:
        allowed = f"{kind.__name__}, {ends[0]} to {ends[1]}"
    else:
        return InvalidInput(f"{section or cls.__name__}: {reason(error)}")
    return InvalidInput(f"{title} must be {allowed}; got {given!r}")
