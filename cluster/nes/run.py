"""One NES run on a pool, generation by generation, each durable before it counts."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, Self

from bilevel.decode import decode
from bilevel.errors import InvalidInput, OtherVersion, StorageFailure
from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource
from bilevel.hyperparameters import Hyperparameters, NESHyperparameters, StoredHyperparameters
from bilevel.nes import NES, NESState
from bilevel.nes.checkpoint import save_state
from bilevel.tasks import Task
from cluster.storage.run_folder import RunStatus, Settings, read_settings, settings_of

STATE_FILE = "state.safetensors"

#: The kind of run that `settings.json` tells, of one that is no study's.
KIND = "nes"


class Pool(Protocol):
    """What evaluates requests: actors (`cluster.ray.pool.EvaluationPool`), or anything else."""

    @property
    def size(self) -> int:
        """Number of cores."""

    def run(
        self,
        task: Task,
        se: SESource,
        requests: Sequence[EvaluationRequest],
        on_result: Callable[[EvaluationResult], None],
    ) -> Sequence[EvaluationResult]:
        """Evaluate all requests, in any order, and call `on_result` with each result."""


def start_of(nes: NESHyperparameters) -> str:
    """The start of a run, in words."""
    if nes.start == "distilled":
        return "from an SE distilled from values of the real task"
    if nes.start_candidates == 1:
        return "from a random SE"
    return f"from the best of {nes.start_candidates} random SEs"


@dataclass(frozen=True, kw_only=True)
class NESSettings(Settings, StoredHyperparameters):
    """The settings of an NES run: its hyperparameters without `nes.generations`."""

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the settings of the run in a folder. Raises InvalidInput."""
        return decode(cls, read_settings(folder), f"{str(folder)!r} holds no NES run")


@dataclass(frozen=True)
class NESRun:
    """An NES run that lives in a folder: its state is the file `state.safetensors`.

    Opened again, it goes on after the last finished generation.
    """

    task: Task
    hp: Hyperparameters
    seed: int
    folder: Path

    def __post_init__(self) -> None:
        _ = self.nes  # raises InvalidInput before anything is written

    def settings(self) -> dict[str, Any]:
        """What must stay the same when the run is continued: all but the number of
        generations, which may grow."""
        hp = self.hp.to_dict()
        del hp["nes"]["generations"]
        agents = [agent.agent for agent in self.hp.agents]
        return {**settings_of(KIND, self.task, self.seed, agents), **hp}

    @classmethod
    def read(cls, folder: Path) -> "NESRun":
        """The run in a folder, as it was begun. Raises InvalidInput."""
        settings, run_status = NESSettings.read(folder), RunStatus.load(folder)
        generations = 1 if run_status is None else run_status.target
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
        """Whether a process has run it to its end, with as many generations as it has now."""
        run_status = RunStatus.load(self.folder)
        if run_status is None or run_status.status != "FINISHED":
            return False
        return run_status.target >= self.hp.nes.generations

    @property
    def begun(self) -> bool:
        """Whether there is a state on disk, be it damaged."""
        return (self.folder / STATE_FILE).exists()

    def load(self) -> NESState | None:
        """The state on disk, if there is one. Raises InvalidInput if damaged."""
        return self.nes.load(self.folder / STATE_FILE) if self.begun else None

    def load_if_sound(self) -> NESState | None:
        """The state on disk; None if there is none, or it is damaged and will be run again. Raises
        StorageFailure for one that cannot be read."""
        try:
            return self.load()
        except StorageFailure:
            raise
        except InvalidInput:
            return None

    def open(self, log: Callable[[str], None] = lambda line: None) -> NESState:
        """The state on disk, or a new one.

        A damaged checkpoint is set aside, with a message, and the run begins anew: it comes to
        the same state again. Raises OtherVersion for a checkpoint of another version, and
        StorageFailure for one that cannot be read.
        """
        state = None
        try:
            state = self.load()
        except (OtherVersion, StorageFailure):
            raise
        except InvalidInput as error:
            path = self.folder / STATE_FILE
            aside = path.with_suffix(".damaged")
            path.replace(aside)
            log(f"{error}; it is now {aside.name!r}, and its generations are run again")
        if state is None:
            state = self.nes.init()
            save_state(state, self.folder / STATE_FILE)
        return state

    def advance(
        self,
        state: NESState,
        pool: Pool,
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> NESState:
        """Run one generation, or one round of the choice of a start or of a confirmation; it is on
        disk when this returns. Raises StorageFailure."""
        nes, before = self.nes, state.generation
        started = time.perf_counter()
        results = pool.run(self.task, state.se, nes.ask(state), on_result)
        state = nes.tell(state, results)
        if state.generation > before:
            state = state.timed(time.perf_counter() - started, pool.size, time.time())
        save_state(state, self.folder / STATE_FILE)
        return state
