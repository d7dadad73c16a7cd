"""What a study is, wherever and however often it is run."""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, StorageFailure
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task
from cluster.bohb.brackets import Schedule
from cluster.bohb.journal import ConfigId, Configuration
from cluster.nes_loop import NESRun
from cluster.profiles import METHODS, get_method
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
    """A search over NES runs on a task. All of it stays the same when it is continued."""

    folder: Path
    task: Task
    seed: int
    space: str
    schedule: Schedule
    base: Hyperparameters  # what a configuration leaves unsaid
    method: str = "bohb"  # of METHODS

    @property
    def name(self) -> str:
        """The study's name."""
        return self.folder.name

    @property
    def method_name(self) -> str:
        """Its method, for people."""
        return METHODS[self.method]

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents that evaluations draw from."""
        return tuple(hp.agent for hp in self.base.agents)

    @property
    def fitted(self) -> bool:
        """Whether its runs start from SEs fitted to the task."""
        return self.base.nes.start == "fitted"

    @property
    def start_file(self) -> Path:
        """Holds the number of the start seed that all runs from fitted SEs share."""
        return self.folder / "start.json"

    @property
    def start_seeds(self) -> list[int]:
        """Seeds of runs from fitted SEs, of which one is chosen for all."""
        return [self._seed(number) for number in range(self.base.nes.start_candidates)]

    def read_start(self) -> int | None:
        """Number of the seed that was chosen; None if none was, or the file is damaged."""
        try:
            number = json.loads(self.start_file.read_bytes())["number"]
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return None
        known = type(number) is int and 0 <= number < self.base.nes.start_candidates
        return number if known else None

    def write_start(self, number: int) -> None:
        """All runs have that seed. Raises StorageFailure."""
        write_aside(self.start_file, json.dumps({"number": number}).encode())

    def fitted_run(self, seed: int, hp: Hyperparameters, folder: Path) -> NESRun:
        """A run from the SE that is fitted by its seed."""
        one = replace(hp, nes=replace(hp.nes, start_candidates=1))
        return NESRun(self.task, one, seed, folder)

    def run(self, config_id: ConfigId, configuration: Configuration) -> NESRun:
        """The NES run of a configuration; its seed is derived from the study's.

        Runs from fitted SEs all have the same: they are fitted to the same steps and action
        values, and what tells them apart is their configurations, not their agents (common
        random numbers). Raises InvalidInput for a configuration that is not allowed,
        StorageFailure where the seed's number should be on disk and is not.
        """
        hp = to_hyperparameters(self.base, configuration)
        folder = self.folder / "configurations" / configuration_name(config_id)
        if not self.fitted:
            return NESRun(self.task, hp, self._seed(*config_id), folder)
        number = self.read_start()
        if number is None:
            raise StorageFailure(
                f"{str(self.start_file)!r} is missing or damaged: the same command chooses the "
                "start again"
            )
        return self.fitted_run(self.start_seeds[number], hp, folder)

    def _seed(self, *path: int) -> int:
        return int(np.random.SeedSequence([self.seed, *path]).generate_state(1)[0])

    def settings(self) -> dict[str, Any]:
        """What `settings.json` holds of it."""
        return {
            "kind": KIND,
            "task": asdict(self.task),
            "seed": self.seed,
            "space": self.space,
            "method": self.method,
            "budgets": list(self.schedule.budgets),
            "cycle": self.schedule.cycle,
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
                Schedule(tuple(map(int, settings["budgets"])), int(settings["cycle"])),
                Hyperparameters.from_dict(settings["base"]),
                get_method(str(settings["method"])),
            )
            if study.space not in SPACES or study.seed < 0:
                raise ValueError(f"space {study.space!r}, seed {study.seed}")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InvalidInput(f"{str(folder)!r} holds no study: {error}") from None
        return study
