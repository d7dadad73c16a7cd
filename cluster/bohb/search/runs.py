"""The NES runs of a configuration: one seed after another until its budget is spent."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from bilevel.nes import NESState
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import StoredSE
from cluster.bohb.search.objective import Tally
from cluster.bohb.study.definition import Study, configuration_name
from cluster.bohb.study.journal import ConfigId, Configuration
from cluster.nes.run import NESRun, Pool
from search_spaces.translation import to_hyperparameters


@dataclass
class ConfigurationRuns:
    """The runs of a configuration in the search, or in its validation, and their states. Each run
    has a folder."""

    study: Study
    id: ConfigId
    configuration: Configuration
    validation: bool = False
    log: Callable[[str], None] = lambda line: None
    states: list[NESState] = field(default_factory=list)

    def read(self) -> Self:
        """Read the runs on disk up to the first damaged one, which restarts in `advance`. Raises
        InvalidInput for an invalid configuration."""
        while (state := self.run(len(self.states)).load_if_sound()) is not None:
            self.states.append(state)
        return self

    @property
    def tally(self) -> Tally:
        """Costs and successes of all runs."""
        return Tally.of(self.states, self.study.task)

    @property
    def generations(self) -> int:
        """Number of generations of all runs."""
        return sum(state.generation for state in self.states)

    @property
    def best(self) -> StoredSE | None:
        """The first confirmed SE, or else the one with the highest scores; None before the first
        generation."""
        evolved = [state for state in self.states if state.finalists]
        evolved.sort(key=lambda state: state.finalists[0].rank, reverse=True)
        confirmed = [state for state in self.states if state.confirmed]
        best = next(iter((*confirmed, *evolved)), None)
        return None if best is None else self.run(0).nes.best(best)

    def run(self, number: int) -> NESRun:
        """Return a run by its number, from 0.

        Its seed depends on the study's seed, the configuration's id and the number, so that no two
        configurations share a random start. Raises InvalidInput for an invalid configuration.
        """
        hp = to_hyperparameters(self.study.base, self.configuration)
        purpose = Purpose.VALIDATION if self.validation else Purpose.CONFIGURATION
        seed = derive(self.study.seed, purpose, *self.id, number)
        configuration = self.study.folder / "configurations" / configuration_name(self.id)
        folder = configuration / f"{'validation' if self.validation else 'run'}-{number}"
        return NESRun(self.study.task, hp, seed, folder)

    def spent(self, budget: float) -> bool:
        """Return whether the runs have cost `budget` core seconds (estimated)."""
        finished = all(state.finished for state in self.states[:-1])
        return finished and self.tally.cost >= budget

    def advance(self, pool: Pool) -> NESState:
        """Advance the first unfinished run, or open or start the next one; return its state. Raises
        StorageFailure, and OtherVersion."""
        unfinished = (i for i, state in enumerate(self.states) if not state.finished)
        number = next(unfinished, len(self.states))
        run = self.run(number)
        if number == len(self.states):
            on_disk = run.state_file.exists()  # after a damaged run, or damaged itself
            self.states.append(run.open(self.log))
            if on_disk:  # possibly finished
                return self.states[number]
        self.states[number] = run.advance(self.states[number], pool)
        return self.states[number]

    def spend(self, budget: float, pool: Pool) -> None:
        """Advance until the runs have cost `budget` core seconds."""
        while not self.spent(budget):
            self.advance(pool)
