"""What a study is, wherever and however often it is run."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bilevel.errors import InvalidInput
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.bohb.journal import ConfigId, Configuration
from cluster.nes_loop import NESRun
from cluster.run_folder import read_settings, stored_task
from search_spaces import SPACES, to_hyperparameters

#: The kind of run that `settings.json` tells.
KIND = "study"


def configuration_name(config_id: ConfigId) -> str:
    """`bracket-rung-number`, zero-padded so that names sort."""
    bracket, rung, number = config_id
    return f"{bracket:03d}-{rung}-{number:03d}"


@dataclass(frozen=True)
class Study:
    """BOHB over NES runs on a task. All of it stays the same when it is continued."""

    folder: Path
    task: Task
    seed: int
    space: str
    budgets: tuple[int, ...]  # generations, ascending
    base: Hyperparameters  # what a configuration leaves unsaid
    model: bool = True  # False leaves Hyperband with random picks

    @property
    def name(self) -> str:
        """The study's name."""
        return self.folder.name

    @property
    def method(self) -> str:
        """What proposes its configurations."""
        return "BOHB" if self.model else "Hyperband"

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents that evaluations draw from."""
        return tuple(hp.agent for hp in self.base.agents)

    def run(self, config_id: ConfigId, configuration: Configuration) -> NESRun:
        """The NES run of a configuration; its seed is derived from the study's.

        Raises InvalidInput for a configuration that is not allowed.
        """
        seed = int(np.random.SeedSequence([self.seed, *config_id]).generate_state(1)[0])
        folder = self.folder / "configurations" / configuration_name(config_id)
        return NESRun(self.task, to_hyperparameters(self.base, configuration), seed, folder)

    def settings(self) -> dict[str, Any]:
        """What `settings.json` holds of it."""
        return {
            "kind": KIND,
            "task": asdict(self.task),
            "seed": self.seed,
            "space": self.space,
            "budgets": list(self.budgets),
            "model": self.model,
            "base": self.base.to_dict(),
        }

    @classmethod
    def read(cls, folder: Path) -> "Study":
        """The study in a folder. Raises InvalidInput."""
        settings = read_settings(folder)
        try:
            study = cls(
                folder,
                stored_task(settings["task"]),
                int(settings["seed"]),
                str(settings["space"]),
                tuple(int(budget) for budget in settings["budgets"]),
                Hyperparameters.from_dict(settings["base"]),
                bool(settings["model"]),
            )
            if study.space not in SPACES or study.seed < 0 or not study.budgets:
                raise ValueError(f"space {study.space!r}, seed {study.seed}, {study.budgets}")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InvalidInput(f"{str(folder)!r} holds no study: {error}") from None
        return study
