import math
from argparse import Namespace
from pathlib import Path
from typing import Any

import pytest

from benchmarks import machine
from benchmarks.nes import run
from benchmarks.search import compare
from benchmarks.search.compare import (
    BUDGETS,
    FRESH_SEED,
    Comparison,
    brackets_of,
    fresh_run,
    outcomes,
    run_in_process,
)
from bilevel.errors import StorageFailure
from bilevel.hyperparameters import Hyperparameters
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import VALIDATION_FILE
from cluster.bohb.study.brackets import core_seconds_to_run
from cluster.bohb.study.journal import ConfigLine, Journal, Origin, ResultLine
from cluster.bohb.study.profiles import METHODS
from cluster.nes.run import Pool
from tests.studies import MadeUpPool, new_study


def ignore(line: str) -> None:
    pass


@pytest.mark.parametrize("method", METHODS)
def test_all_methods_have_the_same_core_time(method: str) -> None:
    brackets, schedule = brackets_of(method, 900)
    spent = core_seconds_to_run(schedule.brackets(brackets))
    assert abs(spent - 900) <= core_seconds_to_run(schedule.brackets(1)) / 2
    assert schedule.budgets[-1] == BUDGETS[-1]


def test_a_search_in_one_process_is_validated_and_resumes(tmp_path: Path) -> None:
    study = new_study(tmp_path / "study")
    found = run_in_process(study, 2, MadeUpPool(), ignore)
    assert len(found.finalists) == 2
    assert found.incumbent == found.finalists[0]
    results = study.folder / "results.json"
    results.write_text("".join(results.read_text().splitlines(keepends=True)[:-1]))
    (study.folder / VALIDATION_FILE).unlink()
    again = run_in_process(study, 2, MadeUpPool(), ignore)
    for before, after in (
        (found.journal.results, again.journal.results),
        (found.finalists, again.finalists),
    ):
        assert [line.loss for line in before] == [line.loss for line in after]


def fail_at_the_second(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the second configuration raise an error."""
    spend = ConfigurationRuns.spend

    def failing(runs: ConfigurationRuns, budget: float, pool: Pool) -> None:
        if runs.id == (0, 0, 1):
            raise error
        spend(runs, budget, pool)

    monkeypatch.setattr(ConfigurationRuns, "spend", failing)


def test_a_failed_configuration_does_not_end_a_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fail_at_the_second(ValueError("an error in the run"), monkeypatch)
    found = run_in_process(new_study(tmp_path / "study"), 1, MadeUpPool(), ignore)
    assert [line.id for line in found.journal.results if line.loss is None] == [(0, 0, 1)]
    assert found.incumbent is not None


def test_a_full_disk_ends_the_search_which_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = new_study(tmp_path / "study")
    fail_at_the_second(StorageFailure("cannot write: the disk is full"), monkeypatch)
    with pytest.raises(StorageFailure):
        run_in_process(study, 1, MadeUpPool(), ignore)
    monkeypatch.undo()
    assert [line.id for line in Journal(study.folder).results] == [(0, 0, 0)]
    found = run_in_process(study, 1, MadeUpPool(), ignore)
    assert all(line.loss is not None for line in found.journal.results)


def test_outcomes_by_origin(tmp_path: Path) -> None:
    """A failure counts as infinite, and the recipe's own result does not count."""
    journal = Journal(tmp_path)
    infos: list[dict[str, Any]] = [{"prior": "itself"}, {}, {"model_based_pick": True}, {}]
    for number, info in enumerate(infos):
        journal.add_config(ConfigLine((0, 0, number), {}, info))
    stamps = {"submitted": 0.0, "started": 0.0, "finished": 1.0}
    for number, budget, loss in ((0, 1, 9.0), (1, 1, None), (2, 1, 7.0), (3, 1, 8.0), (2, 3, 1.0)):
        info = {"confirmed": 2} if loss == 8.0 else {}
        journal.add_result(ResultLine((0, 0, number), budget, loss, info, stamps))
    found = outcomes(journal)
    assert found["3"][Origin.MODEL] == [(1.0, 0)]
    assert found["1"] == {
        Origin.RANDOM: [(math.inf, 0), (8.0, 2)],
        Origin.AROUND_RECIPE: [],
        Origin.MODEL: [(7.0, 0)],
    }


def test_a_fresh_run_depends_on_configuration_and_seed(
    small_hp: Hyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "FINAL_AGENTS", 1)
    monkeypatch.setattr(compare, "base_of", lambda task: small_hp)
    first, second = (fresh_run("CartPole-v0", {"nes.generations": 1}, seed) for seed in (0, 1))
    assert first["generations"] == 1
    assert fresh_run("CartPole-v0", {"nes.generations": 1}, 0) == first
    assert first["score"] != second["score"]


def test_a_comparison_resumes_from_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path)
    options = Namespace(task="CartPole-v0", seeds=[3], core_seconds=10, fresh=2, home=tmp_path)
    default = [("default", FRESH_SEED), ("default", FRESH_SEED + 1)]
    begun = Comparison(options)
    assert begun.missing_searches() == [f"{method} 3" for method in METHODS]
    assert begun.missing_fresh_runs() == default
    begun.add_search("bohb 3", {"configuration": {"nes.step_size": 1.0}})
    begun.add_fresh_run("bohb 3", {"seed": FRESH_SEED + 1})
    options.seeds = [4]
    resumed = Comparison(options)
    assert "--seeds 3-4 " in resumed.command
    assert resumed.missing_fresh_runs() == [*default, ("bohb 3", FRESH_SEED)]
    assert resumed.configuration("bohb 3") == {"nes.step_size": 1.0}
    assert set(resumed.missing_searches()) == {f"{m} {s}" for m in METHODS for s in (3, 4)} - {
        "bohb 3"
    }
