"""What an NES run carries from one generation to the next, on disk and in memory."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from bilevel.errors import InvalidInput
from bilevel.synthetic_env.storage import write_aside


@dataclass(frozen=True)
class GenerationRecord:
    """One generation, as reported everywhere.

    Scores are mean returns on the real task; `score_*`, `train_*` and
    `solved_fraction` are of the agents trained on psi itself.
    """

    generation: int  # from 0
    score_mean: float
    score_std: float
    score_best: float
    perturbed_score_mean: float  # of the agents trained on psi +- eps
    train_steps_mean: float  # environment steps on the SE
    train_episodes_mean: float
    solved_fraction: float  # of the agents trained on psi
    non_finite: int  # evaluations of the generation whose numbers diverged
    psi_norm: float
    update_norm: float
    env_steps_per_second: float  # of one core
    generation_seconds: float


@dataclass(frozen=True)
class NESState:
    """The run after `generation` generations.

    `best_psi` is the SE whose own agents scored highest on average; a run may
    degrade after it has solved the task, so it is kept beside the current one.
    """

    psi: NDArray[np.float32]  # (P,)
    best_psi: NDArray[np.float32]  # (P,)
    generation: int = 0
    best_generation: int = -1
    best_score: float = float("-inf")
    solved_streak: int = 0  # generations solved in a row, up to the last one
    records: tuple[GenerationRecord, ...] = field(default=())

    @property
    def objective(self) -> float:
        """Mean over the generations of the score of each: the area under the
        learning curve, so that fast and good both count."""
        return float(np.mean([record.score_mean for record in self.records]))

    def save(self, path: Path) -> None:
        """Write durably (aside, flushed, renamed)."""
        header = {
            "generation": self.generation,
            "best_generation": self.best_generation,
            "best_score": self.best_score,
            "solved_streak": self.solved_streak,
            "records": [asdict(record) for record in self.records],
        }
        tensors = {"psi": self.psi, "best_psi": self.best_psi}
        write_aside(path, safetensors.numpy.save(tensors, {"nes": json.dumps(header)}))

    @classmethod
    def load(cls, path: Path) -> "NESState":
        """The inverse of `save`. Raises InvalidInput for a damaged file."""
        try:
            with safetensors.safe_open(path, framework="numpy") as file:
                header = json.loads(file.metadata()["nes"])
                psi, best_psi = file.get_tensor("psi"), file.get_tensor("best_psi")
            records = tuple(GenerationRecord(**record) for record in header.pop("records"))
            state = cls(psi=psi, best_psi=best_psi, records=records, **header)
            if state.generation != len(records) or psi.shape != best_psi.shape:
                raise ValueError("its parts do not fit together")
            return state
        except (SafetensorError, OSError, ValueError, TypeError, KeyError) as error:
            raise InvalidInput(f"damaged checkpoint {str(path)!r}: {error}") from None
