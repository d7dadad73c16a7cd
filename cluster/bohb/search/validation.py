"""Validation: the best configurations of a search run again with new seeds.

The best of many noisy results is also the luckiest, so its objective is too optimistic. Before a
recipe is exported, the configurations with the best results, and the recipe that the search started
with, run NES with new seeds, each for the same core time:

    finalists <- the recipe, the last winner, and the best results at the largest budgets
    while there is time and some finalist has not spent its core seconds:
        advance the finalist with the lowest cost by a generation
    incumbent <- the lowest objective over these runs

A resumed search is validated again, and the runs of earlier finalists are reused. A search that
would give each finalist less than half of its largest budget is not validated.
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

#: Maximum number of finalists, including the recipe. The last winner may be a further one.
FINALISTS = 3
#: Share of a study's core time, and of its time budget, for validation.
SHARE = 0.25
#: Share of its core seconds that each finalist must have spent at the deadline for a comparison.
#: The search's largest budget is always enough. (Finalists may use fewer cores than trials do.)
_ENOUGH = 0.5

#: File of a study with its last validation.
VALIDATION_FILE = "validation.json"


@dataclass(frozen=True)
class Validation:
    """Results of the finalists over new seeds."""

    results: int  # number of results of the search that the finalists were chosen from
    #: Best first; budgets are the core seconds of the new runs.
    finalists: Annotated[tuple[ResultLine, ...], Field(min_length=1)]

    @classmethod
    def load(cls, folder: Path) -> Self | None:
        """Read a study's last validation; None without one. Raises InvalidInput if damaged."""
        path = folder / VALIDATION_FILE
        return decode_file(cls, path, "damaged validation") if path.exists() else None

    def save(self, folder: Path) -> None:
        """Write durably. Raises StorageFailure."""
        write_aside(folder / VALIDATION_FILE, json.dumps(asdict(self)).encode())

    @property
    def winner(self) -> ResultLine:
        """The finalist with the lowest objective."""
        return self.finalists[0]

    @property
    def outcome(self) -> list[Any]:
        """Everything except times."""
        return [self.results, *((line.id, line.budget, line.info) for line in self.finalists)]


@dataclass(frozen=True)
class Plan:
    """The finalists of a validation, and the core seconds of new runs of each."""

    finalists: tuple[ConfigId, ...]  # in the order of their proposals
    core_seconds: int

    @classmethod
    def of(cls, journal: Journal, before: Validation | None, largest: int) -> Self | None:
        """Plan a validation that takes SHARE of the study's core time and gives each finalist the
        `largest` budget of the schedule if possible.

        The winner of the validation `before` is always a finalist; without results since then, all
        of its finalists are. Returns None if there is nothing to compare, or if two finalists would
        get less than half of the largest budget.
        """
        core_seconds = validation_seconds(sum(journal.reached.values()))
        number = min(max(int(core_seconds / largest), 2), FINALISTS)
        chosen = {journal.recipe} & journal.reached.keys()
        for line in sorted(journal.successes, key=lambda line: (-line.budget, line.objective)):
            if len(chosen) < number:
                chosen.add(line.id)
        if before is not None and before.results == len(journal.results):
            chosen = {line.id for line in before.finalists}
        elif before is not None:
            chosen.add(before.winner.id)
        if len(chosen) < 2 or core_seconds / number < largest / 2:
            return None
        finalists = tuple(line.id for line in journal.configs if line.id in chosen)
        return cls(finalists, math.ceil(core_seconds / min(number, len(chosen))))


def validation_seconds(searched: float) -> float:
    """Return the core seconds of the validation of a search that took `searched` core seconds."""
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
    """Run or resume the finalists until `is_over`, and write the result; None if the time was too
    short or all finalists failed.

    `progress` is called with the core seconds spent and planned. Raises StorageFailure, and
    OtherVersion.
    """
    each, proposals = plan.core_seconds, journal.proposals
    finalists = [
        ConfigurationRuns.open(study, id, proposals[id].configuration, log, validation=True)
        for id in plan.finalists
    ]
    started = time.time()
    while (unfinished := [runs for runs in finalists if not runs.spent(each)]) and not is_over():
        spent = sum(min(runs.tally.cost, each) for runs in finalists)
        progress(spent, float(each * len(finalists)))
        behind = min(unfinished, key=lambda runs: runs.tally.cost)
        try:
            behind.advance(pool)
        except (StorageFailure, OtherVersion):
            raise
        except Exception as error:  # as in the search, other configurations may succeed
            finalists.remove(behind)
            log(f"{configuration_name(behind.id)} failed with new seeds: {last_line(str(error))}")
    enough = min(_ENOUGH * each, study.schedule.budgets[-1])
    if not finalists or min(runs.tally.cost for runs in finalists) < enough:
        return None
    times = {"submitted": started, "started": started, "finished": time.time()}
    tallies = sorted(((runs.id, runs.tally) for runs in finalists), key=lambda t: t[1].objective)
    validation = Validation(
        len(journal.results),
        tuple(
            ResultLine(id, round(tally.cost), tally.objective, tally.info, times)
            for id, tally in tallies
        ),
    )
    before = Validation.load(study.folder)
    if before is not None and before.outcome == validation.outcome:
        return before  # nothing was run: keep its times
    validation.save(study.folder)
    return validation
