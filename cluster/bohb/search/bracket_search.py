"""The search as jobs and results: hpbandster's brackets and config generator with a journal.

    replay the journal
    repeat:
        job    <- next_job()     # the next free place in any open bracket
        result <- run the job
        register(job, loss)      # journal, then bracket, then model

A proposal depends only on the seed, its number and the earlier results in the journal.
"""

import time
from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import Any

import ConfigSpace as CS
from hpbandster.optimizers.iterations import SuccessiveHalving

from bilevel.errors import InvalidInput
from cluster.bohb.search.config_generator import ConfigGenerator, hpbandster_job
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import (
    ConfigId,
    ConfigLine,
    Configuration,
    Journal,
    Origin,
    ResultLine,
)


@dataclass(frozen=True)
class Job:
    """Run this configuration until it has spent `budget` core seconds."""

    id: ConfigId
    configuration: Configuration
    budget: int
    origin: Origin
    submitted: float  # unix time, seconds


class BracketSearch:
    """The search of a study with `brackets` brackets, or more if its journal has more.

    Raises InvalidInput for a journal that does not belong to the study.
    """

    def __init__(self, study: Study, journal: Journal, brackets: int) -> None:
        self._space = study.space.build(study.agents)
        self.journal = journal
        self._generator = ConfigGenerator(
            self._space, study.seed, study.method == "bohb", study.prior_configuration()
        )
        self._recorded = journal.proposals
        started = max((bracket for bracket, _, _ in self._recorded), default=-1) + 1
        self._brackets = [
            SuccessiveHalving(
                HPB_iter=number,
                num_configs=[rung.configurations for rung in study.schedule.bracket(number)],
                budgets=[rung.budget for rung in study.schedule.bracket(number)],
                config_sampler=partial(self._sample, number),
            )
            for number in range(max(brackets, started))
        ]
        self._interrupted = self._replay()

    @property
    def finished(self) -> bool:
        """True once every bracket has all results."""
        return not self._interrupted and all(bracket.is_finished for bracket in self._brackets)

    def next_job(self) -> Job | None:
        """Return the next job; None while all open rungs wait for results."""
        if self._interrupted:
            return self._interrupted.popleft()
        jobs = (self._next_job(bracket) for bracket in self._brackets)
        return next((job for job in jobs if job is not None), None)

    def register(
        self,
        job: Job,
        loss: float | None,
        info: dict[str, Any] | None = None,
        exception: str | None = None,
    ) -> None:
        """Record the result of a job; a failure has no loss and ranks last."""
        times = {"submitted": job.submitted, "started": job.submitted, "finished": time.time()}
        number = None if loss is None else float(loss)
        line = ResultLine(job.id, job.budget, number, info or {}, times, exception)
        self.journal.add_result(line)
        self._apply(line, job.configuration)

    def put_back(self, job: Job) -> None:
        """Return an interrupted job, which becomes the next one."""
        self._interrupted.appendleft(job)

    def _sample(self, number: int, budget: float) -> tuple[Configuration, dict[str, Any]]:
        """Return the next configuration of a bracket. hpbandster calls this on the lowest rung, and
        on higher ones to replace failures."""
        bracket = self._brackets[number]
        place = number, bracket.stage, bracket.actual_num_configs[bracket.stage]
        line = self._recorded.get(place)
        if line is None:
            line = ConfigLine(place, *self._generator.propose(len(self.journal.configs), budget))
            self.journal.add_config(line)
            return line.configuration, line.info
        try:
            CS.Configuration(self._space, values=line.configuration)
        except (ValueError, KeyError, TypeError) as error:
            raise self._damaged(f"configuration {place}: {error}") from None
        return line.configuration, line.info

    def _next_job(self, bracket: SuccessiveHalving) -> Job | None:
        run = bracket.get_next_run()
        if run is None:
            return None
        config_id, configuration, budget = run
        line = ConfigLine(config_id, configuration, bracket.data[config_id].config_info)
        return Job(config_id, configuration, int(budget), line.origin, time.time())

    def _apply(self, line: ResultLine, configuration: Configuration) -> None:
        self._brackets[line.id[0]].register_result(hpbandster_job(line, configuration))
        self._generator.learn(line, configuration)

    def _replay(self) -> deque[Job]:
        """Apply the journal to brackets and model; return the started jobs without results."""
        open_jobs: dict[tuple[ConfigId, int], Job] = {}
        for line in self.journal.results:
            key = line.id, line.budget
            while key not in open_jobs:
                job = self._next_job(self._brackets[line.id[0]])
                if job is None:
                    raise self._damaged(f"no job leads to {line.id} at budget {line.budget}")
                open_jobs[job.id, job.budget] = job
            self._apply(line, open_jobs.pop(key).configuration)
        return deque(open_jobs.values())

    def _damaged(self, reason: str) -> InvalidInput:
        return InvalidInput(
            f"damaged journal in {str(self.journal.folder)!r}: {' '.join(reason.split())}"
        )
