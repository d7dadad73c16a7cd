"""The search on disk: `configs.json` and `results.json`, one JSON value a line.

This is hpbandster's own format, so its tools read it
(`hpbandster.core.result.logged_results_to_HBS_result(folder)`).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field, FiniteFloat, PositiveInt

from cluster.storage.jsonl_log import JsonlLog

_Number = Annotated[int, Field(ge=0, lt=10**6)]
ConfigId = tuple[_Number, _Number, _Number]  # bracket, rung it entered at, number in that rung
Configuration = dict[str, Any]


class Origin(StrEnum):
    """Where a configuration comes from."""

    RECIPE = "the recipe, within the space"
    AROUND_RECIPE = "drawn around the recipe"
    RANDOM = "drawn at random"
    MODEL = "proposed by the model"


class ConfigLine(NamedTuple):
    """A configuration was proposed: a line of `configs.json`."""

    id: ConfigId
    configuration: Configuration
    info: dict[str, Any]  # {"model_based_pick": bool}, and "prior" where it comes from that

    @property
    def origin(self) -> Origin:
        """Where it comes from."""
        if self.info.get("model_based_pick"):
            return Origin.MODEL
        if not self.info.get("prior"):
            return Origin.RANDOM
        return Origin.RECIPE if self.info["prior"] == "itself" else Origin.AROUND_RECIPE


@dataclass(frozen=True)
class ResultLine:
    """A configuration has spent a budget, or failed on the way (`loss` None)."""

    id: ConfigId
    budget: int
    loss: float | None  # the objective, which is minimised
    info: dict[str, Any]  # of `Tally.info`, and core_utilisation
    timestamps: dict[str, float]  # submitted, started, finished; unix time, seconds
    exception: str | None = None

    @property
    def objective(self) -> float:
        """The objective of a result that is no failure."""
        assert self.loss is not None
        return self.loss

    @property
    def finished(self) -> float:
        """When it came; unix time, seconds."""
        return self.timestamps["finished"]


@dataclass(frozen=True)
class _Stamps:
    """When a job was submitted, started and finished; unix time, seconds."""

    submitted: FiniteFloat
    started: FiniteFloat
    finished: FiniteFloat


@dataclass(frozen=True)
class _Result:
    """Result of a job that did not fail."""

    loss: FiniteFloat
    info: dict[str, Any]


class _ResultRow(NamedTuple):
    """A line of `results.json`."""

    id: ConfigId
    budget: PositiveInt
    timestamps: _Stamps
    result: _Result | None
    exception: str | None

    @property
    def line(self) -> ResultLine:
        """Convert to a ResultLine."""
        loss, info = (None, {}) if self.result is None else (self.result.loss, self.result.info)
        return ResultLine(self.id, self.budget, loss, info, asdict(self.timestamps), self.exception)


class Journal:
    """Reads the two files once, then appends to them.

    Raises InvalidInput for a damaged line, a result of a configuration that was never
    proposed, or a duplicate entry.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._config_file = JsonlLog(folder / "configs.json")
        self._result_file = JsonlLog(folder / "results.json")
        self.configs = self._config_file.decoded(ConfigLine)
        self.results = [row.line for row in self._result_file.decoded(_ResultRow)]
        _require_once(self._config_file, [line.id for line in self.configs])
        _require_once(self._result_file, [(line.id, line.budget) for line in self.results])
        proposed = {line.id for line in self.configs}
        for index, line in enumerate(self.results):
            if line.id not in proposed:
                raise self._result_file.damaged(index, f"{line.id} was never proposed")

    @property
    def paths(self) -> list[Path]:
        """The journal's files."""
        return [self._config_file.path, self._result_file.path]

    @property
    def proposals(self) -> dict[ConfigId, ConfigLine]:
        """The proposed configurations by their ids, in their order."""
        return {line.id: line for line in self.configs}

    @property
    def successes(self) -> list[ResultLine]:
        """The results that are no failures, in their order."""
        return [line for line in self.results if line.loss is not None]

    @property
    def began(self) -> float:
        """When the first job of a result was submitted, unix time in seconds; 0 without results."""
        return min((line.timestamps["submitted"] for line in self.results), default=0.0)

    @property
    def recipe(self) -> ConfigId | None:
        """The configuration of the recipe that the search began with, if it did."""
        return next((line.id for line in self.configs if line.origin is Origin.RECIPE), None)

    @property
    def reached(self) -> dict[ConfigId, int]:
        """Core seconds that each configuration has spent: the budget of its last result."""
        return {line.id: line.budget for line in self.successes}

    def add_config(self, line: ConfigLine) -> None:
        """Append a proposal, durably. Raises StorageFailure."""
        self._config_file.append([line.id, line.configuration, line.info])
        self.configs.append(line)

    def add_result(self, line: ResultLine) -> None:
        """Append a result, durably. Raises StorageFailure."""
        result = None if line.loss is None else {"loss": line.loss, "info": line.info}
        self._result_file.append([line.id, line.budget, line.timestamps, result, line.exception])
        self.results.append(line)


def _require_once(file: JsonlLog, keys: Sequence[object]) -> None:
    """Raises InvalidInput for a line whose key an earlier one has."""
    seen: set[object] = set()
    for index, key in enumerate(keys):
        if key in seen:
            raise file.damaged(index, f"duplicate entry {key}")
        seen.add(key)
