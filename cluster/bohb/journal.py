"""The search on disk: `configs.json` and `results.json`, one JSON value a line.

This is hpbandster's own format, so its tools read it
(`hpbandster.core.result.logged_results_to_HBS_result(folder)`). Lines are only ever
appended, each flushed to the disk; a last line that was cut short is dropped.
"""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bilevel.errors import InvalidInput

ConfigId = tuple[int, int, int]  # bracket, rung it entered at, number in that rung
Configuration = dict[str, Any]


@dataclass(frozen=True)
class ConfigLine:
    """A configuration was proposed."""

    id: ConfigId
    configuration: Configuration
    info: dict[str, Any]  # {"model_based_pick": bool}


@dataclass(frozen=True)
class ResultLine:
    """A configuration reached a budget, or failed on the way (`loss` None)."""

    id: ConfigId
    budget: int
    loss: float | None
    info: dict[str, Any]
    timestamps: dict[str, float]  # submitted, started, finished; seconds
    exception: str | None = None

    @property
    def objective(self) -> float | None:
        """What is maximised: the loss with its sign turned."""
        return None if self.loss is None else -self.loss


class Journal:
    """Reads the two files once, then appends to them."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._configs_path = folder / "configs.json"
        self._results_path = folder / "results.json"
        try:
            self.configs = [
                ConfigLine(_config_id(i), dict(configuration), dict(info))
                for i, configuration, info in _read(self._configs_path)
            ]
            self.results = [
                ResultLine(
                    _config_id(i),
                    int(budget),
                    None if result is None else float(result["loss"]),
                    {} if result is None else dict(result["info"]),
                    dict(timestamps),
                    exception,
                )
                for i, budget, timestamps, result, exception in _read(self._results_path)
            ]
        except (ValueError, TypeError, KeyError) as error:
            raise InvalidInput(f"damaged journal in {str(folder)!r}: {error}") from None

    @property
    def paths(self) -> list[Path]:
        """The journal's files."""
        return [self._configs_path, self._results_path]

    def add_config(self, line: ConfigLine) -> None:
        """Append a proposal."""
        _append(self._configs_path, [line.id, line.configuration, line.info])
        self.configs.append(line)

    def add_result(self, line: ResultLine) -> None:
        """Append a result."""
        result = None if line.loss is None else {"loss": line.loss, "info": line.info}
        row = [line.id, line.budget, line.timestamps, result, line.exception]
        _append(self._results_path, row)
        self.results.append(line)


def _config_id(value: Any) -> ConfigId:
    bracket, rung, number = (int(part) for part in value)
    return bracket, rung, number


def _read(path: Path) -> list[Any]:
    path.touch()
    data = path.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        with path.open("r+b") as file:
            file.truncate(len(whole))
    return [json.loads(line) for line in whole.splitlines()]


def _append(path: Path, value: Any) -> None:
    with path.open("a") as file:
        file.write(json.dumps(value) + "\n")
        file.flush()
        os.fsync(file.fileno())
