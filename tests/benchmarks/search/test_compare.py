import os
import sys
import time
from argparse import Namespace
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import numpy as np
import psutil
import pytest

import bilevel
from benchmarks import machine
from benchmarks.nes import run
from benchmarks.readme import ROOT
from benchmarks.search import compare
from benchmarks.search.compare import (
    SPACE,
    Comparison,
    InProcess,
    brackets_of,
    fresh_run,
    kept_evaluations,
    run_in_process,
)
from bilevel.errors import StorageFailure
from bilevel.evaluation import EvaluationRequest, EvaluationResult, SESource, evaluate
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NES
from bilevel.nes.checkpoint import save_state
from bilevel.tasks import Task, get_task
from cluster.bohb.search.runs import ConfigurationRuns
from cluster.bohb.search.validation import VALIDATION_FILE
from cluster.bohb.study.brackets import core_seconds_to_run
from cluster.bohb.study.journal import Journal
from cluster.bohb.study.profiles import METHODS
from cluster.nes.run import Pool
from search_spaces.bohb import search_space
from tests.studies import MadeUpPool, new_study


def test_the_space_is_core_without_the_length_of_episodes() -> None:
    core, space = search_space("core"), CS.ConfigurationSpace.from_json(SPACE)
    assert set(core) - set(space) == {"se.step_limit", "se.spread"}
    assert dict(space) == {name: core[name] for name in space}


def test_all_methods_have_the_same_core_time() -> None:
    for method in METHODS:
        brackets, schedule = brackets_of(method, 900)
        spent = core_seconds_to_run(schedule.brackets(brackets))
        assert abs(spent - 900) <= core_seconds_to_run(schedule.brackets(1)) / 2


def test_a_search_in_one_process_is_validated_and_resumes(tmp_path: Path) -> None:
    study = new_study(tmp_path / "study")
    lines: list[str] = []
    found = run_in_process(study, 2, MadeUpPool(), lines.append)
    assert len(found.finalists) == 2
    assert found.incumbent == found.finalists[0]
    assert [line for line in lines if line.startswith("study: objective")]
    _, results = Journal(study.folder).paths
    results.write_text("".join(results.read_text().splitlines(keepends=True)[:-1]))
    (study.folder / VALIDATION_FILE).unlink()
    again = run_in_process(study, 2, MadeUpPool(), lines.append)
    assert [line.loss for line in again.journal.results] == [
        line.loss for line in found.journal.results
    ]
    assert [line.loss for line in again.finalists] == [line.loss for line in found.finalists]


def test_a_failing_configuration_does_not_end_a_search(tmp_path: Path) -> None:
    study = new_study(tmp_path / "study")
    in_the_way = study.folder / "configurations" / "000-0-001"
    in_the_way.parent.mkdir(parents=True)
    in_the_way.write_text("")  # where its folder should be
    found = run_in_process(study, 1, MadeUpPool(), lambda line: None)
    failed = [line for line in found.journal.results if line.loss is None]
    assert [line.id for line in failed] == [(0, 0, 1)]
    assert found.incumbent is not None


def test_a_full_disk_is_no_failure_of_a_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ends the search, which the same command resumes."""
    study, spend = new_study(tmp_path / "study"), ConfigurationRuns.spend

    def full(runs: ConfigurationRuns, budget: float, pool: Pool) -> None:
        if runs.id == (0, 0, 1):
            raise StorageFailure("cannot write: the disk is full")
        spend(runs, budget, pool)

    monkeypatch.setattr(ConfigurationRuns, "spend", full)
    with pytest.raises(StorageFailure):
        run_in_process(study, 1, MadeUpPool(), lambda line: None)
    monkeypatch.undo()
    assert [line.id for line in Journal(study.folder).results] == [(0, 0, 0)]
    found = run_in_process(study, 1, MadeUpPool(), lambda line: None)
    assert all(line.loss is not None for line in found.journal.results)


def test_a_fresh_run_is_a_function_of_configuration_and_number(
    tmp_path: Path, small_hp: Hyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "FINAL_AGENTS", 1)  # of any size
    monkeypatch.setattr(compare, "base_of", lambda task: small_hp)
    small = {"nes.generations": 1}
    one, other = (fresh_run("CartPole-v0", small, number, tmp_path) for number in (0, 1))
    assert fresh_run("CartPole-v0", small, 0, tmp_path / "elsewhere") == one
    assert one["score"] != other["score"]
    assert other["seed"] == one["seed"] + 1
    assert not one["confirmed"]
    assert one["solved"] == (one["score"] >= 195)
    assert one["generations"] == 1


def test_what_a_search_has_evaluated_is_not_evaluated_again(
    tmp_path: Path, small_hp: Hyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = get_task("CartPole-v0")
    nes = NES(task, small_hp, 0)
    state = nes.init()
    first = InProcess(tmp_path).run(task, state.se, nes.ask(state))
    assert [result.index for result in first] == [request.index for request in nes.ask(state)]
    made: list[EvaluationRequest] = []

    def counted(task: Task, se: SESource, request: EvaluationRequest) -> EvaluationResult:
        made.append(request)
        return evaluate(task, se, request)

    monkeypatch.setattr(compare, "evaluate", counted)
    save_state(state, tmp_path / "state.safetensors")  # as another process finds it
    read = nes.load(tmp_path / "state.safetensors")
    told: list[EvaluationResult] = []
    assert InProcess(tmp_path).run(task, read.se, nes.ask(read), told.append) == first == told
    assert not made
    moved = replace(state.se, mean=state.se.mean + np.float32(0.1))
    InProcess(tmp_path).run(task, moved, nes.ask(state))
    assert made == list(nes.ask(state))
    InProcess(tmp_path).run(task, state.se, NES(task, small_hp, 1).ask(state))
    assert made == [*nes.ask(state), *NES(task, small_hp, 1).ask(state)]


def test_evaluations_of_other_code_are_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "bilevel"
    for path in ("__init__.py", "kernels/ddqn.py", "nes/rules.py"):
        (package / path).parent.mkdir(parents=True, exist_ok=True)
        (package / path).write_text("")
    monkeypatch.setattr(bilevel, "__file__", str(package / "__init__.py"))
    before = kept_evaluations(tmp_path, "CartPole-v0")._kept
    (package / "nes/rules.py").write_text("it chooses requests, and evaluates none")
    assert kept_evaluations(tmp_path, "CartPole-v0")._kept == before
    (package / "kernels/ddqn.py").write_text("another kernel")
    assert kept_evaluations(tmp_path, "CartPole-v0")._kept != before


def test_searches_with_equal_seeds_follow_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Side by side, they would evaluate the same configurations at the same time."""
    monkeypatch.setattr(machine, "RESULTS", tmp_path)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    options = Namespace(
        task="CartPole-v0", seeds=[0, 1, 2], core_seconds=10, fresh=2, home=tmp_path / "home"
    )
    pairs = [f"{method} {seed}" for method in METHODS for seed in (0, 1)]
    last = [f"{method} 2" for method in METHODS]
    assert [*Comparison(options).rows] == ["default", *pairs, *last]


def test_a_comparison_goes_on_where_its_file_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "RESULTS", tmp_path)
    options = Namespace(
        task="CartPole-v0", seeds=[3], core_seconds=10, fresh=2, home=tmp_path / "home"
    )

    def missing() -> dict[str, list[int | None]]:
        comparison = Comparison(options)  # from the file
        return {key: [one.number for one in comparison.missing(key)] for key in comparison.rows}

    searches: dict[str, list[int | None]] = {f"{method} 3": [None] for method in METHODS}
    assert missing() == {"default": [0, 1], **searches}
    begun = Comparison(options)
    (asked,) = begun.missing("bohb 3")
    begun.add(asked, {"configuration": {"nes.step_size": 1.0}})
    second = begun.missing("bohb 3")[1]
    assert second.arguments == ("CartPole-v0", {"nes.step_size": 1.0}, 1, options.home)
    begun.add(second, {"seed": 10_001})
    assert missing() == {"default": [0, 1], **searches, "bohb 3": [0]}
    options.seeds = [4]
    with pytest.raises(SystemExit, match="has the seeds 3, too"):
        missing()


def test_an_unknown_task_is_told_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home = tmp_path / "home"
    asked = ["compare", "CartPole-v9", "--seeds", "0", "--home", str(home)]
    monkeypatch.setattr(sys, "argv", asked)
    with pytest.raises(SystemExit) as ended:
        compare.main()
    assert ended.value.code == 2
    assert "argument task: unknown task 'CartPole-v9': allowed" in capsys.readouterr().err
    assert not home.exists()


@pytest.mark.timeout(180)
def test_searches_end_with_a_killed_command(tmp_path: Path) -> None:
    """They would go on beside those of the command that resumes them."""
    elsewhere = (  # where nothing has been measured
        "from benchmarks import machine; from benchmarks.search import compare; "
        f"machine.RESULTS = machine.Path({str(tmp_path)!r}); compare.main()"
    )
    options = ("CartPole-v0", "--seeds", "999", "--fresh", "0", "--home", tmp_path)
    command = psutil.Popen([sys.executable, "-c", elsewhere, *options], cwd=ROOT)
    while not [*tmp_path.glob("CartPole-v0/*/settings.json")]:
        assert command.poll() is None
        time.sleep(0.05)
    searches = command.children()
    command.kill()
    command.wait()
    for search in searches:
        with suppress(psutil.NoSuchProcess):
            while search.status() != psutil.STATUS_ZOMBIE:
                time.sleep(0.05)
