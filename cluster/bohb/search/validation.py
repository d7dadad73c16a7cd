"""The finalists of a search, on new seeds: which of them is handed over.

The best of many noisy results is also the luckiest, so its objective is too good. Before a recipe
is handed over, the configurations with the best results, and the recipe that the search began with,
run NES with seeds that the search made no choice on, each for at least the same core time:

    finalists <- the recipe, the last winner, and the best results at the largest budgets
    while time is left and some finalist has not spent its core seconds:
        the finalist that has spent least advances by a generation
    incumbent <- the best objective over these runs alone

A search that goes on is validated again; the runs of finalists that were there before count again.
One that has hardly begun is not: less time than half of its largest budget would tell too little.
"""

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field

from bilevel.decode import decode_file
from bilevel.durable import write_aside
from bilevel.errors import OtherVersion, StorageFailure
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import Study, configuration_name
from cluster.bohb.study.journal import ConfigId, Journal, ResultLine
from cluster.nes.run import Pool
from cluster.session.terminal import last_line

#: Most configurations that a search validates, the recipe that it began with among them. The last
#: winner may come on top.
FINALISTS = 3
#: Share of a study's core time, and of its time budget, that is kept for validation.
SHARE = 0.25
#: Part of the core seconds that finalists must have spent when time is up, to be compared; the
#: search's largest budget is always enough. (Its trials fill any number of cores, the generations
#: of its finalists do not.)
_ENOUGH = 0.5

#: File of a study with its last validation.
VALIDATION_FILE = "validation.json"


@dataclass(frozen=True)
class Validation:
    """What the finalists' new runs came to."""

    results: int  # of the search, by which the finalists were chosen
    #: Best first; budgets are of the new runs alone.
    finalists: Annotated[tuple[ResultLine, ...], Field(min_length=1)]

    @classmethod
    def load(cls, folder: Path) -> Self | None:
        """A study's last one; None before the first. Raises InvalidInput if damaged."""
        path = folder / VALIDATION_FILE
        return decode_file(cls, path, "damaged validation") if path.exists() else None

    def is_of(self, journal: Journal) -> bool:
        """Whether the journal has the results by which the finalists were chosen."""
        chosen_by = journal.results[: self.results]
        known = {line.id for line in chosen_by if line.loss is not None}
        return len(chosen_by) == self.results and {line.id for line in self.finalists} <= known

    def save(self, folder: Path) -> None:
        """Write durably. Raises StorageFailure."""
        write_aside(folder / VALIDATION_FILE, json.dumps(asdict(self)).encode())

    @property
    def outcome(self) -> list[Any]:
        """What came of it, without the times when it ran."""
        return [self.results, *((line.id, line.budget, line.info) for line in self.finalists)]

    @property
    def winner(self) -> ResultLine:
        """The finalist that is handed over."""
        return self.finalists[0]


@dataclass(frozen=True)
class Plan:
    """Who is validated, and for how long."""

    finalists: tuple[ConfigId, ...]  # in the order of their proposals
    core_seconds: int  # of new runs of each

    @classmethod
    def of(cls, journal: Journal, before: Validation | None, largest: int) -> Self | None:
        """SHARE of the study's core time, for as many finalists as get the `largest` budget of its
        schedule each; the last winner comes on top, whose earlier runs count. Those of the
        validation `before`, if the search has no results since. None for a search that is too short
        for it: two would get less than half."""
        results = journal.successes
        best = sorted(results, key=lambda line: (-line.budget, line.loss))
        searched = sum(journal.reached.values())
        core_seconds = validation_seconds(searched)
        number = min(max(int(core_seconds / largest), 2), FINALISTS)
        chosen = {journal.recipe} & journal.reached.keys()
        for line in best:
            if len(chosen) < number:
                chosen.add(line.id)
        enough = core_seconds / number >= largest / 2
        if before is not None:
            chosen.add(before.winner.id)
            if before.results == len(journal.results):
                chosen = {line.id for line in before.finalists}
        if len(chosen) < 2 or not enough:
            return None
        places = tuple(line.id for line in journal.configs if line.id in chosen)
        return cls(places, math.ceil(core_seconds / min(number, len(chosen))))


def least_search(largest: int) -> float:
    """Core seconds that a search must have taken to be validated, `largest` being the largest
    budget of its schedule."""
    return largest / SHARE * (1 - SHARE)


def validation_seconds(searched: float) -> float:
    """Core seconds of the validation of a search that took so many; it needs at least the search's
    largest budget."""
    return SHARE / (1 - SHARE) * searched


def validate(
    study: Study,
    journal: Journal,
    plan: Plan,
    pool: Pool,
    log: Callable[[str], None],
    progress: Callable[[float, float], None],
    is_over: Callable[[], bool],
) -> Validation | None:
    """Run the finalists and write what came of it; None if the time was not enough for that.

    `progress` takes the core seconds spent and those of all finalists. What has been run is on
    disk, and is not run again. A finalist whose runs fail is left out; None if all do. Raises
    StorageFailure, and OtherVersion.
    """
    each = plan.core_seconds
    proposals = journal.proposals
    runs = [
        ConfigurationRuns.open(study, one, proposals[one].configuration, log, validation=True)
        for one in plan.finalists
    ]
    started = time.time()
    while (left := [one for one in runs if not one.spent(each)]) and not is_over():
        progress(sum(min(one.tally.cost, each) for one in runs), float(each * len(runs)))
        behind = min(left, key=lambda one: one.tally.cost)
        try:
            behind.advance(pool)
        except (StorageFailure, OtherVersion):
            raise
        except Exception as error:  # as in the search: others may go on
            runs.remove(behind)
            name = configuration_name(behind.id)
            log(f"{name} failed with new seeds, and is left out: {last_line(str(error))}")
    enough = min(_ENOUGH * each, study.schedule.budgets[-1])
    if not runs or min(one.tally.cost for one in runs) < enough:
        return None
    now = time.time()
    stamps = {"submitted": started, "started": started, "finished": now}
    lines = [
        ResultLine(one.id, round(one.tally.cost), one.tally.objective, one.tally.info, stamps)
        for one in runs
    ]
    found = Validation(len(journal.results), tuple(sorted(lines, key=lambda line: line.objective)))
    before = Validation.load(study.folder)
    if before is not None and before.outcome == found.outcome:
        return before  # read from disk again: the times when it ran stay
    found.save(study.folder)
    return found
