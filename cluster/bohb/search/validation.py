"""Validation: the best configurations of a search run again with new seeds.

The best of many noisy results is also the luckiest, so its objective is too optimistic. Before a
recipe is exported, the configurations with the best results, and the recipe that the search started
with, run NES with new seeds, each for the same core time:

    finalists <- the recipe, and the best results at the largest budgets
    while there is time and some finalist has not spent its core seconds:
        advance the finalist with the lowest cost by a generation
    incumbent <- the lowest objective over these runs

A search with new results is validated again, and finalists resume their earlier runs. A search that
would give each finalist less than half of its largest budget is not validated.
"""

import json
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field

from bilevel.decode import decode_file
from bilevel.durable import write_aside
from bilevel.errors import OtherVersion, StorageFailure
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.study.definition import Study, configuration_name
from cluster.bohb.study.journal import ConfigId, Journal, Origin, ResultLine
from cluster.nes.run import Pool
from cluster.session.terminal import last_line

#: Maximum number of finalists, including the recipe.
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

    @classmethod
    def of(cls, journal: Journal, finalists: Iterable[ConfigurationRuns], started: float) -> Self:
        """Rank finalists, whose runs were started at `started` (unix time, seconds)."""
        times = {"submitted": started, "started": started, "finished": time.time()}
        tallies = ((runs.id, runs.tally) for runs in finalists)
        lines = [ResultLine(id, round(t.cost), t.objective, t.info, times) for id, t in tallies]
        return cls(len(journal.results), tuple(sorted(lines, key=lambda line: line.objective)))


def finalists_of(journal: Journal, largest: int) -> list[ConfigId]:
    """Return at most FINALISTS configurations, in the order of their proposals: those that can run
    for the `largest` budget of the schedule within SHARE of the study's core time.

    Empty if there is nothing to compare, or if two would get less than half of that budget.
    """
    core_seconds = validation_seconds(sum(journal.reached.values()))
    number = min(max(int(core_seconds / largest), 2), FINALISTS)
    recipe = {line.id for line in journal.configs if line.origin is Origin.RECIPE}
    chosen = recipe & {line.id for line in journal.successes}
    for line in sorted(journal.successes, key=lambda line: (-line.budget, line.objective)):
        if len(chosen) < number:
            chosen.add(line.id)
    if len(chosen) < 2 or core_seconds / number < largest / 2:
        return []
    return [line.id for line in journal.configs if line.id in chosen]


def validation_seconds(searched: float) -> float:
    """Return the core seconds of the validation of a search that took `searched` core seconds."""
    return SHARE / (1 - SHARE) * searched


def validate(
    study: Study,
    journal: Journal,
    pool: Pool,
    log: Callable[[str], None],
    progress: Callable[[float, float], None] = lambda spent, planned: None,
    is_over: Callable[[], bool] = lambda: False,
) -> Validation | None:
    """Run or resume a validation until `is_over`, and write and log the result; None if the search
    or the time was too short, or if all finalists failed.

    `progress` is called with the core seconds spent and planned. Raises StorageFailure, and
    OtherVersion.
    """
    chosen = finalists_of(journal, study.schedule.budgets[-1])
    if not chosen:
        return None
    each = math.ceil(validation_seconds(sum(journal.reached.values())) / len(chosen))
    before = Validation.load(study.folder)
    costs = [] if before is None else [line.info["core_seconds"] for line in before.finalists]
    if before is not None and before.results == len(journal.results) and min(costs) >= each:
        return before
    log(f"validating {len(chosen)} configurations with new seeds")
    started, proposals = time.time(), journal.proposals
    finalists = [
        ConfigurationRuns(study, id, proposals[id].configuration, validation=True, log=log).read()
        for id in chosen
    ]
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
    validation = Validation.of(journal, finalists, started)
    write_aside(study.folder / VALIDATION_FILE, json.dumps(asdict(validation)).encode())
    return validation
