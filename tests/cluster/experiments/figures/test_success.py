"""Statistics of learning curves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bilevel.tasks import Task
from cluster.experiments.experiment import Findings
from cluster.experiments.figures.success import SUCCESS, findings_of, scores_by_run
from cluster.experiments.style import styled
from tests.cluster.experiments.artificial import material_of, smoke_plan


def curves(*runs: list[float]) -> pd.DataFrame:
    """Return runs with these scores, which take a core second per generation."""
    return pd.DataFrame(
        {
            "condition": "default",
            "seed": seed,
            "generation": generation,
            "score": score,
            "core_seconds": generation + 1.0,
            "update_norm": (generation + 1) / 10,
        }
        for seed, scores in enumerate(runs)
        for generation, score in enumerate(scores)
    )


def findings(task: Task, *runs: list[float], final: list[float]) -> Findings:
    """Return the findings of runs that spend seven core seconds after the last generation."""
    seconds = [len(scores) + 7.0 for scores in runs]
    ends = pd.DataFrame({"condition": "default", "core_seconds": seconds, "final_score": final})
    with styled():
        return findings_of(curves(*runs), ends, task)


def test_runs_that_stop_early_keep_their_last_score() -> None:
    np.testing.assert_array_equal(scores_by_run(curves([1, 2], [3, 4, 5])), [[1, 2, 2], [3, 4, 5]])


def test_shares_of_runs(cartpole: Task) -> None:
    runs = (
        [10.0, 196.0],  # stops when it is solved
        [10.0, 20.0, 199.0, 50.0],  # solved before the end
        [10.0, 20.0, 30.0, 40.0],  # solves the task with the exported SE only
        [195.0, 0.0, 0.0, 0.0],
    )
    (row,) = findings(cartpole, *runs, final=[200.0, 150.0, 200.0, 0.0]).summary
    assert row["runs"] == 4
    assert row["ever_solved"] == 0.75
    assert row["solved_at_end"] == 0.25
    assert row["best_se_solves"] == 0.5
    assert row["median_first_solved"] == 1.0
    assert row["core_seconds_first_solved"] == 2.0
    assert row["core_seconds"] == 4 + 7
    assert row["update_norm"] == pytest.approx(0.2)
    assert row["score_at_end"] == pytest.approx((196 + 50 + 40 + 0) / 4)


def test_no_run_solves_the_task(cartpole: Task) -> None:
    (row,) = findings(cartpole, [10.0, 20.0], final=[20.0]).summary
    assert row["ever_solved"] == 0.0
    assert row["median_first_solved"] is row["core_seconds_first_solved"] is None


def test_core_seconds_include_the_last_confirmation(tmp_path: Path) -> None:
    """It follows the last generation's record."""
    plan = smoke_plan(SUCCESS)
    material = material_of(SUCCESS, plan, tmp_path)
    for source in material.sources:
        assert source.run is not None
        state = source.state
        source.run.nes.save(replace(state, cost=state.cost + 5), source.run.state_file)
    found = SUCCESS.conclude(plan, material)
    last = found.data.groupby("condition")["core_seconds"].max()
    for row in found.summary:
        assert row["core_seconds"] == pytest.approx(last[row["condition"]] + 5)
