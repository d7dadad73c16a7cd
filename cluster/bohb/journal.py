"""The search on disk: `configs.json` and `results.json`, one JSON value a line.

This is hpbandster's own format, so its tools read it
(`hpbandster.core.result.logged_results_to_HBS_result(folder)`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from cluster.storage.lines import Lines

ConfigId = tuple[int, int, int]  # bracket, rung it entered at, number in that rung
Configuration = dict[str, Any]
_T = TypeVar("_T")


@dataclass(frozen=True)
class ConfigLine:
    """A configuration was proposed."""

    id: ConfigId
    configuration: Configuration
    info: dict[str, Any]  # {"model_based_pick": bool}

    @classmethod
    def read(cls, row: Any) -> "ConfigLine":
        """A line of `configs.json`. Raises ValueError, TypeError."""
        identifier, configuration, info = row
        return cls(_config_id(identifier), _mapping(configuration), _mapping(info))


@dataclass(frozen=True)
class ResultLine:
    """A configuration reached a budget, or failed on the way (`loss` None)."""

    id: ConfigId
    budget: int
    loss: float | None
    info: dict[str, Any]
    timestamps: dict[str, float]  # submitted, started, finished; unix time, seconds
    exception: str | None = None

    @property
    def objective(self) -> float | None:
        """What is maximised: the loss with its sign turned."""
        return None if self.loss is None else -self.loss

    @property
    def finished(self) -> float:
        """When it came; unix time, seconds."""
        return self.timestamps["finished"]

    @classmethod
    def read(cls, row: Any) -> "ResultLine":
        """A line of `results.json`. Raises ValueError, TypeError, KeyError."""
        identifier, budget, timestamps, result, exception = row
        loss = None if result is None else _finite(result["loss"])
        stamps = {name: _finite(_mapping(timestamps)[name]) for name in _STAMPS}
        if type(budget) is not int or budget < 1:
            raise ValueError(f"budget {budget!r}")
        if not (exception is None or isinstance(exception, str)):
            raise TypeError(f"exception {exception!r}")
        info = {} if result is None else _mapping(result["info"])
        return cls(_config_id(identifier), budget, loss, info, stamps, exception)


_STAMPS = ("submitted", "started", "finished")


class Journal:
    """Reads the two files once, then appends to them.

    Raises InvalidInput for a damaged line, a result of a configuration that was never
    proposed, or anything that stands there twice.
    """

    def __init__(self, folder: Path) -> None:
        self._config_file = Lines(folder / "configs.json")
        self._result_file = Lines(folder / "results.json")
        self.configs = _read(self._config_file, ConfigLine.read, lambda line: line.id)
        self.results = _read(
            self._result_file, ResultLine.read, lambda line: (line.id, line.budget)
        )
        proposed = {line.id for line in self.configs}
        for index, line in enumerate(self.results):
            if line.id not in proposed:
                raise self._result_file.damaged(index, f"{line.id} was never proposed")

    @property
    def paths(self) -> list[Path]:
        """The journal's files."""
        return [self._config_file.path, self._result_file.path]

    def add_config(self, line: ConfigLine) -> None:
        """Append a proposal, durably. Raises StorageFailure."""
        self._config_file.append([line.id, line.configuration, line.info])
        self.configs.append(line)

    def add_result(self, line: ResultLine) -> None:
        """Append a result, durably. Raises StorageFailure."""
        result = None if line.loss is None else {"loss": line.loss, "info": line.info}
        self._result_file.append([line.id, line.budget, line.timestamps, result, line.exception])
        self.results.append(line)


def _read(file: Lines, parse: Callable[[Any], _T], key: Callable[[_T], object]) -> list[_T]:
    lines: list[_T] = []
    seen: set[object] = set()
    for index, row in enumerate(file.values):
        try:
            line = parse(row)
        except (ValueError, TypeError, KeyError, OverflowError) as error:
            raise file.damaged(index, error) from None
        if key(line) in seen:
            raise file.damaged(index, f"{key(line)} stands there twice")
        seen.add(key(line))
        lines.append(line)
    return lines


def _config_id(value: Any) -> ConfigId:
    if not (
        isinstance(value, list)
        and len(value) == 3
        and all(type(part) is int and 0 <= part < 10**6 for part in value)
    ):
        raise ValueError(f"configuration id {value!r}")
    return value[0], value[1], value[2]


def _mapping(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise TypeError(f"{value!r} is not an object")
    return value


def _finite(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a finite number")
    return float(value)
