"""Which SEs a study chooses among."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from cluster.bohb.handover import Handover, _contenders, all_runs
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import Plan, Validation, validate
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.journal import ConfigId, Journal
from cluster.nes.selection import RACERS
from tests.studies import MadeUpPool, make_study


def test_confirmed_ses_come_first_then_those_that_scored_highest(tmp_path: Path) -> None:
    study = make_study(tmp_path, brackets=8)
    every = [
        ConfigurationRuns.read(study, line.id, line.configuration)
        for line in Journal(tmp_path).configs
    ]
    begun = [runs for runs in every if runs.states and runs.states[0].finalists]
    worst = min(begun, key=lambda runs: runs.states[0].finalists[0].rank)
    scored = [
        (finalist.rank, se)
        for runs in every
        for state in runs.states
        for finalist, se in zip(state.finalists, state.candidates, strict=False)
        if state is not worst.states[0]
    ]
    scored.sort(key=lambda pair: pair[0], reverse=True)
    worst.states[0] = replace(worst.states[0], finished=True, confirmed=True)
    first, *others = _contenders(every)
    assert first.se == worst.states[0].best
    assert first.hp == worst.run(0).hp
    assert len(scored) > RACERS == 1 + len(others)
    assert [one.se for one in others] == [se for _, se in scored[: RACERS - 1]]


def test_the_runs_of_a_validation_take_part(tmp_path: Path) -> None:
    """They have seeds of their own, and may have the best SE."""
    study = make_study(tmp_path)
    journal, pool, told = Journal(study.folder), MadeUpPool(), list[str]()

    def validated() -> set[ConfigId]:
        every = all_runs(study, journal, pool, told.append)
        return {runs.id for runs in every if runs.validation and runs.states}

    plan = Plan.of(journal, None, study.schedule.budgets[-1])
    assert plan is not None
    assert not validated()
    validate(study, journal, plan, pool, told.append, lambda spent, total: None, lambda: False)
    assert validated() == set(plan.finalists)
    assert not told


def test_a_search_that_is_too_short_for_a_validation_says_so(tmp_path: Path) -> None:
    told: list[str] = []
    session: Any = SimpleNamespace(terminal=SimpleNamespace(log=told.append))
    study = replace(make_study(tmp_path), schedule=Schedule((1000, 3000), 1))
    handover = Handover(study, Journal(study.folder), session)
    handover._validate(MadeUpPool(), lambda: False)
    (line,) = told
    assert re.fullmatch(r"not validated .* took \d+ core seconds, and 9000 are needed", line)

    results = handover.journal.successes
    Validation(len(handover.journal.results), (results[0],)).save(study.folder)
    handover._validate(MadeUpPool(), lambda: False)
    assert told == [line]  # an earlier validation stands
