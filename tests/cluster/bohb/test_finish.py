"""The choice of the SEs that a study retests at its end."""

from dataclasses import replace
from pathlib import Path

from bilevel.nes.state import Finished
from cluster.bohb.finish import all_runs, contenders_of
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import validate
from cluster.bohb.study.journal import Journal
from cluster.nes.selection import RACERS
from tests.studies import MadeUpPool, make_study


def test_confirmed_ses_come_before_those_with_the_highest_scores(tmp_path: Path) -> None:
    study = make_study(tmp_path, brackets=6)
    every = [
        ConfigurationRuns(study, line.id, line.configuration).read()
        for line in Journal(tmp_path).configs
    ]
    evolved = [runs for runs in every if runs.states and runs.states[0].finalists]
    worst = min(evolved, key=lambda runs: runs.states[0].finalists[0].rank)
    scored = [
        (finalist.rank, se)
        for runs in every
        for state in runs.states
        for finalist, se in zip(state.finalists, runs.run(0).nes.candidates(state), strict=False)
        if state is not worst.states[0]
    ]
    scored.sort(key=lambda pair: pair[0], reverse=True)
    worst.states[0] = replace(worst.states[0], phase=Finished(confirmed=True))
    first, *others = contenders_of(every)
    assert (first.se, first.hp) == (worst.run(0).nes.best(worst.states[0]), worst.run(0).hp)
    assert len(scored) > RACERS == 1 + len(others)
    assert [contender.se for contender in others] == [se for _, se in scored[: RACERS - 1]]


def test_the_runs_of_search_and_validation_are_included(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    journal = Journal(study.folder)
    found = validate(study, journal, MadeUpPool(), print)
    assert found is not None
    runs = [each for each in all_runs(study, journal) if each.states]
    assert {each.id for each in runs if each.validation} == {line.id for line in found.finalists}
    assert {each.id for each in runs if not each.validation} == {
        line.id for line in journal.configs
    }
