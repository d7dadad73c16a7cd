"""Frozen dataclasses whose fields carry, and check, their allowed range."""

from dataclasses import MISSING, Field, field, fields
from typing import Any, Self

from bilevel.errors import InvalidInput, one_of


def ranged(low: float, high: float, default: Any = MISSING) -> Any:
    """A number in [low, high]."""
    return field(default=default, metadata={"low": low, "high": high})


def choice(options: tuple[str, ...], default: Any = MISSING) -> Any:
    """One of the named options."""
    return field(default=default, metadata={"options": options})


def allowed(spec: Field[Any]) -> str:
    """What a field allows, in words."""
    if "options" in spec.metadata:
        return ", ".join(spec.metadata["options"])
    if "low" in spec.metadata:
        return f"{spec.metadata['low']} to {spec.metadata['high']}"
    return "true or false"


class Validated:
    """Base of the hyperparameter dataclasses: checked when built."""

    def __post_init__(self) -> None:
        for spec in fields(self):  # type: ignore[arg-type]
            self._check(spec, getattr(self, spec.name))

    def _check(self, spec: Field[Any], value: Any) -> None:
        kind = type(self).__name__.removesuffix("Hyperparameters")
        if "options" in spec.metadata:
            if value not in spec.metadata["options"]:
                raise one_of(f"{kind} {spec.name}", value, spec.metadata["options"])
            return
        accepted = {int: (int,), float: (int, float), bool: (bool,)}[spec.type]  # type: ignore[index]
        right_type = isinstance(value, accepted) and (
            spec.type is bool or not isinstance(value, bool)
        )
        in_range = right_type and (
            "low" not in spec.metadata or spec.metadata["low"] <= value <= spec.metadata["high"]
        )
        if not in_range:
            assert isinstance(spec.type, type)
            raise InvalidInput(
                f"{kind} {spec.name} must be {spec.type.__name__}, {allowed(spec)}; got {value!r}"
            )

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Build from a mapping; an unknown or missing name is an InvalidInput."""
        names = [spec.name for spec in fields(cls)]  # type: ignore[arg-type]
        for name in values:
            if name not in names:
                raise one_of(f"{cls.__name__} field", name, names)
        try:
            return cls(**values)
        except TypeError as error:
            raise InvalidInput(f"{cls.__name__}: {error}") from None
