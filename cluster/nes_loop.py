"""One NES run on a pool, generation by generation, each durable before it counts."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bilevel import __version__
from bilevel.errors import InvalidInput
from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES, NESState
from bilevel.synthetic_env import StoredSE
from bilevel.tasks import Task
from cluster.pool import EvaluationPool
from cluster.run_folder import Standing, read_settings, stored_task
from search_spaces import draw_agent

STATE_FILE = "state.safetensors"

#: The kind of run that `settings.json` tells, of one that is no study's.
KIND = "nes"


@dataclass(frozen=True)
class NESRun:
    """An NES run that lives in a folder: its state is the file `state.safetensors`.

    Opened again, it goes on after the last finished generation.
    """

    task: Task
    hp: Hyperparameters
    seed: int
    folder: Path

    def settings(self) -> dict[str, Any]:
        """What must stay the same when the run is continued: all but the number of
        generations, which may grow."""
        hp = self.hp.to_dict()
        del hp["nes"]["generations"]
        return {"kind": KIND, "task": asdict(self.task), "seed": self.seed, **hp}

    @classmethod
    def read(cls, folder: Path) -> "NESRun":
        """The run in a folder, as it was begun. Raises InvalidInput."""
        settings, standing = read_settings(folder), Standing.load(folder)
        try:
            generations = standing.target if standing is not None else 1
            nes = {**settings["nes"], "generations": generations}
            hp = Hyperparameters.from_dict({**settings, "nes": nes})
            return cls(stored_task(settings["task"]), hp, int(settings["seed"]), folder)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InvalidInput(f"{str(folder)!r} holds no NES run: {error}") from None

    @property
    def nes(self) -> NES:
        """The algorithm."""
        return NES(self.task, self.hp, self.seed, draw_agent)

    def load(self) -> NESState | None:
        """The state on disk, if there is one. Raises InvalidInput if damaged."""
        path = self.folder / STATE_FILE
        return NESState.load(path) if path.exists() else None

    def load_if_sound(self) -> NESState | None:
        """The same; a damaged one, which will be run again, counts as none till then."""
        try:
            return self.load()
        except InvalidInput:
            return None

    def open(
        self,
        pool: EvaluationPool,
        on_step: Callable[[], None] = lambda: None,
        tell: Callable[[str], None] = lambda line: None,
    ) -> NESState:
        """The state on disk, or a new start, which may take fits and evaluations.

        A damaged checkpoint is set aside, which is told, and the run begins anew:
        it comes to the same state again.
        """
        state = None
        try:
            state = self.load()
        except InvalidInput as error:
            path = self.folder / STATE_FILE
            aside = path.with_suffix(".damaged")
            path.replace(aside)
            tell(f"{error}; it is now {aside.name!r}, and its generations are run again")
        if state is None:
            nes = self.nes
            state = nes.start(
                lambda psi, requests: pool.run(
                    self.task, nes.architecture, psi, requests, lambda result: on_step()
                ),
                lambda seeds: pool.fits(self.task, nes.architecture, seeds, on_step),
            )
            state.save(self.folder / STATE_FILE)
        return state

    def advance(
        self,
        state: NESState,
        pool: EvaluationPool,
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> NESState:
        """Run one generation; it is on disk when this returns. Raises StorageFailure."""
        nes = self.nes
        started = time.perf_counter()
        results = pool.run(self.task, nes.architecture, state.psi, nes.ask(state), on_result)
        seconds = time.perf_counter() - started
        state = nes.tell(state, results, seconds, time.time(), pool.size)
        state.save(self.folder / STATE_FILE)
        return state

    def reach(
        self, generations: int, pool: EvaluationPool, tell: Callable[[str], None]
    ) -> NESState:
        """The state once the run has that many generations, run here if need be."""
        state = self.open(pool, tell=tell)
        while state.generation < generations:
            state = self.advance(state, pool)
        return state

    def finalists(self, state: NESState) -> list[StoredSE]:
        """The best SEs so far, best first, as they go to files."""
        return [
            self._stored(
                f.psi,
                {
                    "generation": f.generation,
                    "score_mean": f.score_mean,
                    "fitness_mean": f.fitness_mean,
                    "perturbed_score_mean": f.perturbed_score_mean,
                },
            )
            for f in state.finalists
        ]

    def last_se(self, state: NESState) -> StoredSE:
        """The current SE, which no agent has been trained on yet."""
        return self._stored(state.psi, {"generation": state.generation})

    def _stored(self, psi: NDArray[np.float32], info: dict[str, object]) -> StoredSE:
        return StoredSE(
            self.nes.architecture,
            psi,
            self.task.id,
            self.task.step_limit,
            self.task.solved_reward,
            {
                "hyperparameters": self.hp.to_dict(),
                "seed": self.seed,
                "bilevel_version": __version__,
                **info,
            },
        )
