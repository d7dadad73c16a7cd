"""One NES run on a pool, generation by generation, each durable before it counts."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bilevel.evaluation import EvaluationResult
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES, NESState
from bilevel.synthetic_env import StoredSE
from bilevel.tasks import Task
from cluster.pool import EvaluationPool
from search_spaces import vary_agent

STATE_FILE = "state.safetensors"


@dataclass(frozen=True)
class NESRun:
    """An NES run that lives in a folder: its state is the file `state.safetensors`.

    Opened again, it goes on after the last finished generation.
    """

    task: Task
    hp: Hyperparameters
    seed: int
    folder: Path

    @property
    def nes(self) -> NES:
        """The algorithm."""
        return NES(self.task, self.hp, self.seed, vary_agent)

    def load(self) -> NESState | None:
        """The state on disk, if there is one. Raises InvalidInput if damaged."""
        path = self.folder / STATE_FILE
        return NESState.load(path) if path.exists() else None

    def open(
        self,
        pool: EvaluationPool,
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> NESState:
        """The state on disk, or a new start (which may take evaluations)."""
        state = self.load()
        if state is None:
            nes = self.nes
            shape = nes.architecture
            screened = pool.run(self.task, shape, None, nes.screening_requests(), on_result)
            retests = nes.retest_requests(screened)
            state = nes.start(screened, pool.run(self.task, shape, None, retests, on_result))
            state.save(self.folder / STATE_FILE)
        return state

    def advance(
        self,
        state: NESState,
        pool: EvaluationPool,
        on_result: Callable[[EvaluationResult], None] = lambda result: None,
    ) -> NESState:
        """Run one generation; it is on disk when this returns."""
        nes = self.nes
        started = time.perf_counter()
        results = pool.run(self.task, nes.architecture, state.psi, nes.ask(state), on_result)
        state = nes.tell(state, results, time.perf_counter() - started)
        state.save(self.folder / STATE_FILE)
        return state

    def stored_se(self, state: NESState, best: bool = True) -> StoredSE:
        """The best SE so far (or the last one), as it goes to a file."""
        from bilevel import __version__

        generation = state.best_generation if best else state.generation
        info = {
            "hyperparameters": self.hp.to_dict(),
            "seed": self.seed,
            "generation": generation,
            "score_mean": state.best_score if best else None,
            "bilevel_version": __version__,
        }
        return StoredSE(
            self.nes.architecture,
            state.best_psi if best else state.psi,
            self.task.id,
            self.task.step_limit,
            self.task.solved_reward,
            info,
        )
