"""The journal of a search: `configs.json` and `results.json`, one JSON value a line.

This is hpbandster's format, which its tools read
(`hpbandster.core.result.logged_results_to_HBS_result(folder)`).
"""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field, FiniteFloat, PositiveInt

from cluster.storage.jsonl_log import JsonlLog

_Number = Annotated[int, Field(ge=0, lt=10**6)]
ConfigId = tuple[_Number, _Number, _Number]  # bracket, rung of its first job, number in that rung
Configuration = dict[str, Any]

#: Files of proposals and results.
JOURNAL_FILES = "configs.json", "results.json"


class Origin(StrEnum):
    """Source of a configuration."""

    RECIPE = "the recipe, within the space"
    AROUND_RECIPE = "drawn around the recipe"
    RANDOM = "drawn at random"
    MODEL = "proposed by the model"


class ConfigLine(NamedTuple):
    """A proposed configuration, a line of `configs.json`."""

    id: ConfigId
    configuration: Configuration
    info: dict[str, Any]  # "model_based_pick", and "prior" if it is the prior or drawn around it

    @property
    def origin(self) -> Origin:
        """Source of the configuration."""
        if self.info.get("model_based_pick"):
            return Origin.MODEL
        if not self.info.get("prior"):
            return Origin.RANDOM
        return Origin.RECIPE if self.info["prior"] == "itself" else Origin.AROUND_RECIPE


@dataclass(frozen=True)
class ResultLine:
    """The result of a configuration at a budget; a failure has no loss."""

    id: ConfigId
    budget: int  # core seconds
    loss: float | None  # the objective, which is minimised
    info: dict[str, Any]  # `Tally.info`
    timestamps: dict[str, float]  # submitted, started, finished; unix time, seconds
    exception: str | None = None

    @property
    def objective(self) -> float:
        """The objective of a result that is not a failure."""
        assert self.loss is not None
        return self.loss

    @property
    def finished(self) -> float:
        """Unix time of the result, in seconds."""
        return self.timestamps["finished"]


@dataclass(frozen=True)
class _Success:
    loss: FiniteFloat
    info: dict[str, Any]


class _ResultRow(NamedTuple):
    """A line of `results.json`."""

    id: ConfigId
    budget: PositiveInt
    timestamps: dict[str, FiniteFloat]
    result: _Success | None
    exception: str | None

    def to_line(self) -> ResultLine:
        loss, info = (None, {}) if self.result is None else (self.result.loss, self.result.info)
        return ResultLine(self.id, self.budget, loss, info, self.timestamps, self.exception)


class Journal:
    """Reads the two files once, then appends to them.

    Raises InvalidInput for a damaged line or a result without its proposal.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._config_file, self._result_file = (JsonlLog(folder / name) for name in JOURNAL_FILES)
        self.configs = self._config_file.decoded(ConfigLine)
        self.results = [row.to_line() for row in self._result_file.decoded(_ResultRow)]
        proposed = self.proposals
        for index, line in enumerate(self.results):
            if line.id not in proposed:
                raise self._result_file.damaged(index, f"{line.id} was never proposed")

    @property
    def proposals(self) -> dict[ConfigId, ConfigLine]:
        """Proposed configurations by id, in order."""
        return {line.id: line for line in self.configs}

    @property
    def successes(self) -> list[ResultLine]:
        """Results that are not failures, in order."""
        return [line for line in self.results if line.loss is not None]

    @property
    def began(self) -> float:
        """Unix time of the first job with a result, in seconds; 0 without results."""
        return min((line.timestamps["submitted"] for line in self.results), default=0.0)

    @property
    def reached(self) -> dict[ConfigId, int]:
        """Core seconds that each configuration has spent: the budget of its last result."""
        return {line.id: line.budget for line in self.results}

    def add_config(self, line: ConfigLine) -> None:
        """Append a proposal durably. Raises StorageFailure."""
        self._config_file.append([line.id, line.configuration, line.info])
        self.configs.append(line)

    def add_result(self, line: ResultLine) -> None:
        """Append a result durably. Raises StorageFailure."""
        result = None if line.loss is None else {"loss": line.loss, "info": line.info}
        self._result_file.append([line.id, line.budget, line.timestamps, result, line.exception])
        self.results.append(line)
