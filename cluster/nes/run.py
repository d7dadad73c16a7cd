"""An NES run in a folder: every generation is durable before it counts."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource
from bilevel.hyperparameters import Hyperparameters, NESHyperparameters, StoredHyperparameters
from bilevel.nes import NES, NESState
from bilevel.tasks import Task
from cluster.storage.run_folder import RunStatus, Settings, settings_of

STATE_FILE = "state.safetensors"

#: Kind of a run in `settings.json`.
KIND = "nes"


class Pool(Protocol):
    """Evaluates requests, such as the actors of `cluster.ray.pool.EvaluationPool`."""

    size: int  # number of cores

    def run(
        self,
        task: Task,
        se: SESource,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None],
    ) -> Sequence[EvaluationResult]:
        """Evaluate all requests, in any order, and call `on_result` with each result."""


def start_of(nes: NESHyperparameters) -> str:
    """Describe the start of a run."""
    if nes.start_candidates == 1:
        return "from a random SE"
    return f"from the best of {nes.start_candidates} random SEs"


@dataclass(frozen=True, kw_only=True)
class NESSettings(Settings, StoredHyperparameters):
    """Settings of an NES run: its hyperparameters without `nes.generations`."""

    noun = "NES run"


@dataclass(frozen=True)
class NESRun:
    """An NES run in a folder, whose state is the file `state.safetensors`.

    An existing run resumes after its last finished generation.
    """

    task: Task
    hp: Hyperparameters
    seed: int
    folder: Path

    def __post_init__(self) -> None:
        _ = self.nes  # raises InvalidInput before anything is written

    def settings(self) -> dict[str, Any]:
        """Return the settings that must not change on resume, without `nes.generations`."""
        hp = self.hp.to_dict()
        del hp["nes"]["generations"]
        return {**settings_of(KIND, self.task, self.seed), **hp}

    @classmethod
    def read(cls, folder: Path) -> "NESRun":
        """Read the run in a folder. Raises InvalidInput."""
        settings, status = NESSettings.read(folder), RunStatus.load(folder)
        generations = 1 if status is None else status.target
        whole = replace(settings, nes={**settings.nes, "generations": generations})
        try:
            return cls(settings.task, whole.checked(), settings.seed, folder)
        except InvalidInput as error:
            raise InvalidInput(f"{str(folder)!r} holds no NES run: {error}") from None

    @property
    def nes(self) -> NES:
        """The algorithm."""
        return NES(self.task, self.hp, self.seed)

    @property
    def ended(self) -> bool:
        """A process has finished the run with its current number of generations."""
        status = RunStatus.load(self.folder)
        if status is None or status.status != "FINISHED":
            return False
        return status.target >= self.hp.nes.generations

    @property
    def state_file(self) -> Path:
        """The checkpoint."""
        return self.folder / STATE_FILE

    def load(self) -> NESState | None:
        """Return the state on disk, if there is one. Raises InvalidInput if it is damaged."""
        return self.nes.load(self.state_file) if self.state_file.exists() else None

    def load_if_sound(self) -> NESState | None:
        """Return the state on disk, or None if it is missing or damaged. Raises StorageFailure if
        it cannot be read."""
        try:
            return self.load()
        except StorageFailure:
            raise
        except InvalidInput:
            return None

    def open(
        self,
        log: Callable[[str], None] = lambda line: None,
        on_step: Callable[[], None] = lambda: None,
    ) -> NESState:
        """Return the state on disk, or a new one (`NES.init`).

        A damaged checkpoint is renamed, with a message, and the run restarts; it will reach the
        same state again. Raises OtherVersion for a checkpoint of another version, and
        StorageFailure if it cannot be read.
        """
        state = None
        try:
            state = self.load()
        except (OtherVersion, StorageFailure):
            raise
        except InvalidInput as error:
            renamed = self.state_file.with_suffix(".damaged")
            self.state_file.replace(renamed)
            log(f"{error}; renamed to {renamed.name!r}, its generations will be repeated")
        if state is None:
            state = self.nes.init(on_step)
            self.nes.save(state, self.state_file)
        return state

    def advance(
        self,
        state: NESState,
        pool: Pool,
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> NESState:
        """Run a generation, or a round of another phase, and save the state. Raises
        StorageFailure."""
        nes, generation = self.nes, state.generation
        started = time.perf_counter()
        results = pool.run(self.task, nes.distribution(state), nes.ask(state), on_result)
        state = nes.tell(state, results)
        if state.generation > generation:
            state = state.timed(time.perf_counter() - started, pool.size, time.time())
        nes.save(state, self.state_file)
        return state
