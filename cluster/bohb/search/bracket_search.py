"""BOHB as jobs and results: hpbandster's brackets and config generator, journaled.

    replay the journal
    repeat:
        job    <- next_job()     # the next free place in any open bracket
        result <- somebody runs it
        register(job, loss)      # journal, then bracket, then model

What is proposed depends on the seed, the number of the proposal, and the results
that came before it; nothing else is remembered between processes.
"""

import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Self

import ConfigSpace as CS
import numpy as np
from hpbandster.core.dispatcher import Job as HpbandsterJob
from hpbandster.optimizers.config_generators.bohb import BOHB
from hpbandster.optimizers.iterations import SuccessiveHalving

from bilevel.errors import InvalidInput
from bilevel.seeds import Purpose, derive, split
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.definition import Study
from cluster.bohb.study.journal import (
    ConfigId,
    ConfigLine,
    Configuration,
    Journal,
    Origin,
    ResultLine,
)
from search_spaces.prior import around
from search_spaces.translation import native

#: Share of the random configurations that are drawn around the prior, if there is one. The others
#: keep the search from believing a wrong one.
AROUND = 0.5


@dataclass(frozen=True)
class Job:
    """Run this configuration until it has spent `budget` core seconds."""

    id: ConfigId
    configuration: Configuration
    budget: int
    origin: Origin
    submitted: float  # unix time, seconds


class BracketSearch:
    """The search over `space` by a schedule, up to so many brackets.

    With a `prior`, the first configuration is that, and about half of the random ones are drawn
    around it. The model begins with the results of an `earlier` search over the same space.
    Raises InvalidInput for a journal that no such search has written.
    """

    def __init__(
        self,
        space: CS.ConfigurationSpace,
        schedule: Schedule,
        brackets: int,
        seed: int,
        journal: Journal,
        model: bool = True,
        prior: Configuration | None = None,
        earlier: Journal | None = None,
    ) -> None:
        self._space = space
        self._schedule = schedule
        self._seed = seed
        self._prior = prior
        self._journal = journal
        # A random fraction of 1 never asks the model.
        with _hpbandsters_warnings_ignored():
            self._generator = BOHB(space, random_fraction=1 / 3 if model else 1.0)
        if earlier is not None:
            proposals = earlier.proposals
            for result in earlier.results:
                # The model of the largest budget proposes: one of a budget that this search never
                # reaches would ignore its results.
                if result.budget in schedule.budgets:
                    self._learn(_hpbandsters(result, proposals[result.id].configuration))
        self._recorded: dict[int, deque[ConfigLine]] = {}
        for line in journal.configs:
            self._recorded.setdefault(line.id[0], deque()).append(line)
        begun = max(self._recorded, default=-1) + 1
        if begun > brackets:
            raise InvalidInput(
                f"{str(journal.folder)!r} has begun {begun} brackets, {brackets} are asked for: "
                f"ask for {begun} at least"
            )
        self._origins = {line.id: line.origin for line in journal.configs}
        self._brackets = [self._bracket(number) for number in range(brackets)]
        self._replaying = True
        self._again = self._replay()
        self._replaying = False

    @classmethod
    def of(cls, study: Study, journal: Journal, brackets: int) -> Self:
        """A study's, from where its journal ends. Raises InvalidInput as the class does."""
        return cls(
            study.space.build(study.agents),
            study.schedule,
            brackets,
            study.search_seed,
            journal,
            study.method == "bohb",
            study.prior_configuration,
            study.earlier,
        )

    @property
    def finished(self) -> bool:
        """Whether every bracket has all its results."""
        return not self._again and all(bracket.is_finished for bracket in self._brackets)

    @property
    def succeeded(self) -> bool:
        """Whether any job has given a result."""
        return bool(self._journal.successes)

    def next_job(self) -> Job | None:
        """The next job, or None while all open rungs wait for results."""
        if self._again:
            return self._again.popleft()
        for bracket in self._brackets:
            job = self._next_of(bracket)
            if job is not None:
                return job
        return None

    def register(
        self,
        job: Job,
        loss: float | None,
        info: dict[str, Any] | None = None,
        exception: str | None = None,
    ) -> None:
        """Record what came of a job; None is a failure and counts as the worst."""
        now = time.time()
        stamps = {"submitted": job.submitted, "started": job.submitted, "finished": now}
        number = None if loss is None else float(loss)
        line = ResultLine(job.id, job.budget, number, info or {}, stamps, exception)
        self._journal.add_result(line)
        self._apply(line, job.configuration)

    def put_back(self, job: Job) -> None:
        """A job that was interrupted is the next one again."""
        self._again.append(job)

    def _bracket(self, number: int) -> SuccessiveHalving:
        rungs = self._schedule.bracket(number)
        return SuccessiveHalving(
            HPB_iter=number,
            num_configs=[rung.configurations for rung in rungs],
            budgets=[rung.budget for rung in rungs],
            config_sampler=self._sampler(number),
        )

    def _sampler(self, number: int) -> Callable[[float], tuple[Configuration, dict[str, Any]]]:
        """What hpbandster calls for the next configuration of a bracket. It asks on
        the lowest rung, and above it when failures left a place empty."""

        def sample(budget: float) -> tuple[Configuration, dict[str, Any]]:
            bracket = self._brackets[number]
            place = (number, bracket.stage, bracket.actual_num_configs[bracket.stage])
            recorded = self._recorded.get(number)
            if recorded:
                line = recorded.popleft()
                if line.id != place:
                    raise self._damaged(line, f"{line.id} stands where {place} should")
                try:
                    CS.Configuration(self._space, values=line.configuration)
                except (ValueError, KeyError, TypeError) as error:
                    raise self._damaged(line, f"configuration of {place}: {error}") from None
                return line.configuration, line.info
            if self._replaying:
                raise self._damaged(None, f"{place} was never proposed, but results follow from it")
            configuration, info = self._propose(budget)
            line = ConfigLine(place, configuration, info)
            self._journal.add_config(line)
            self._origins[place] = line.origin
            return configuration, info

        return sample

    def _propose(self, budget: float) -> tuple[Configuration, dict[str, Any]]:
        """Ask the config generator, with its randomness fixed by seed and number."""
        number = len(self._journal.configs)
        if self._prior is not None and number == 0:
            return dict(self._prior), {"model_based_pick": False, "prior": "itself"}
        seed = derive(self._seed, Purpose.PROPOSAL, number)
        of_model, of_space, of_prior = (word % 2**32 for word in split(seed, 3))
        self._space.seed(of_space)
        with _seeded(of_model), _hpbandsters_warnings_ignored():
            configuration, info = self._generator.get_config(budget)
        rng = np.random.default_rng(of_prior)
        if self._prior is not None and not info["model_based_pick"] and rng.random() < AROUND:
            with suppress(InvalidInput):  # a draw that the space forbids
                configuration = around(self._space, self._prior, rng)
                info = {**info, "prior": True}
        return {name: native(value) for name, value in configuration.items()}, dict(info)

    def _next_of(self, bracket: SuccessiveHalving) -> Job | None:
        run = bracket.get_next_run()
        if run is None:
            return None
        config_id, configuration, budget = run
        return Job(config_id, configuration, int(budget), self._origins[config_id], time.time())

    def _apply(self, line: ResultLine, configuration: Configuration) -> None:
        job = _hpbandsters(line, configuration)
        self._brackets[line.id[0]].register_result(job)
        self._learn(job)

    def _learn(self, job: HpbandsterJob) -> None:
        """Give the model a result; it draws values for hyperparameters that are not active."""
        seed = derive(self._seed, Purpose.IMPUTATION, *job.id, int(job.kwargs["budget"]))
        with _seeded(seed % 2**32), _hpbandsters_warnings_ignored():
            self._generator.new_result(job)

    def _damaged(self, line: ConfigLine | ResultLine | None, reason: str) -> InvalidInput:
        """The error for a line of the journal; None is one that its proposals lack."""
        of_configs, of_results = self._journal.paths
        if isinstance(line, ResultLine):
            path, number = of_results, self._journal.results.index(line) + 1
        elif line is not None:
            path, number = of_configs, self._journal.configs.index(line) + 1
        else:
            path, number = of_configs, len(self._journal.configs) + 1
        return InvalidInput(f"damaged {str(path)!r}, line {number}: {reason}")

    def _replay(self) -> deque[Job]:
        """Bring brackets and model to where the journal ends; return the jobs that
        had been started without a result.

        Raises InvalidInput for a journal that no search has written.
        """
        open_jobs: dict[tuple[ConfigId, int], Job] = {}
        for line in self._journal.results:
            while (line.id, line.budget) not in open_jobs:
                job = self._next_of(self._brackets[line.id[0]])
                if job is None:
                    told = f"nothing led to {line.id} at budget {line.budget}"
                    raise self._damaged(line, told)
                open_jobs[job.id, job.budget] = job
            job = open_jobs.pop((line.id, line.budget))
            self._apply(line, job.configuration)
        return deque(open_jobs.values())


def _hpbandsters(line: ResultLine, configuration: Configuration) -> HpbandsterJob:
    """A result as hpbandster's brackets and model take it."""
    job = HpbandsterJob(line.id, config=configuration, budget=line.budget)
    job.result = None if line.loss is None else {"loss": line.loss, "info": line.info}
    job.timestamps = line.timestamps
    job.exception = line.exception
    return job


@contextmanager
def _seeded(seed: int) -> Iterator[None]:
    """Seed numpy's global generator, from which hpbandster draws, and put it back after."""
    before = np.random.get_state()
    np.random.seed(seed)
    try:
        yield
    finally:
        np.random.set_state(before)


@contextmanager
def _hpbandsters_warnings_ignored() -> Iterator[None]:
    """hpbandster uses names that ConfigSpace has deprecated; were warnings errors,
    they would silently turn model-based picks into random ones."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
