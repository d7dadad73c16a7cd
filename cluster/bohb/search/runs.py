"""The NES runs of a configuration: one seed after the other, as long as its budget lasts."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from bilevel.nes import NESState
from bilevel.synthetic_env import StoredSE
from cluster.bohb.search.objective import Tally
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import ConfigId, Configuration
from cluster.nes.run import NESRun, Pool


@dataclass
class ConfigurationRuns:
    """The runs of a configuration, of the search or of its validation, with their states; each
    lives in its own folder."""

    study: Study
    id: ConfigId
    configuration: Configuration
    validation: bool = False
    states: list[NESState] = field(default_factory=list)

    @classmethod
    def read(
        cls,
        study: Study,
        config_id: ConfigId,
        configuration: Configuration,
        validation: bool = False,
    ) -> Self:
        """What is on disk, without damaged runs and those after them. Raises InvalidInput for a
        configuration that is not allowed."""
        runs = cls(study, config_id, configuration, validation)
        while (state := runs._next.load_if_sound()) is not None:
            runs.states.append(state)
        return runs

    @classmethod
    def open(
        cls,
        study: Study,
        config_id: ConfigId,
        configuration: Configuration,
        log: Callable[[str], None] = lambda line: None,
        validation: bool = False,
    ) -> Self:
        """What is on disk; a damaged run begins anew (`NESRun.open`). Raises InvalidInput, and
        OtherVersion for a run of another version."""
        runs = cls(study, config_id, configuration, validation)
        while runs._next.begun:
            runs.states.append(runs._next.open(log))
        return runs

    @property
    def tally(self) -> Tally:
        """What they have come to."""
        return Tally.of(self.states)

    @property
    def generations(self) -> int:
        """Generations of all runs."""
        return sum(state.generation for state in self.states)

    @property
    def best(self) -> StoredSE | None:
        """The first SE that was confirmed, else the one whose agents scored highest; None before
        the first generation."""
        begun = [state for state in self.states if state.finalists]
        for state in begun:
            if state.confirmed:
                return state.best
        ranked = max(begun, key=lambda state: state.finalists[0].rank, default=None)
        return None if ranked is None else ranked.best

    def run(self, number: int) -> NESRun:
        """The run with that number, from 0."""
        return self.study.run(self.id, self.configuration, number, self.validation)

    def spent(self, budget: float) -> bool:
        """Whether the runs have cost so many core seconds (estimated)."""
        over = all(state.finished for state in self.states[:-1])
        return over and self.tally.cost >= budget

    def advance(self, pool: Pool) -> NESState:
        """Advance the first run that is not over, or begin another (`NESRun.advance`); return its
        state. One that is on disk already, because an earlier one was lost, is only read."""
        number = next(
            (i for i, state in enumerate(self.states) if not state.finished), len(self.states)
        )
        run = self.run(number)
        if number == len(self.states):
            there = run.begun
            self.states.append(run.open())
            if there:  # perhaps over
                return self.states[number]
        self.states[number] = run.advance(self.states[number], pool)
        return self.states[number]

    def spend(self, budget: float, pool: Pool) -> None:
        """Advance until so many core seconds are spent."""
        while not self.spent(budget):
            self.advance(pool)

    @property
    def _next(self) -> NESRun:
        return self.run(len(self.states))
