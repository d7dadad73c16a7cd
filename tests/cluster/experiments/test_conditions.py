"""Conditions, sizes and names."""

from pathlib import Path

import pytest

from bilevel.nes import NES
from bilevel.tasks import get_task
from cluster.cli.evaluate import NAMES
from cluster.experiments.conditions import CONDITIONS
from cluster.experiments.figures import EXPERIMENTS
from cluster.experiments.sizes import SIZES
from cluster.experiments.style import COLOURS
from cluster.storage.home import Home


@pytest.mark.parametrize("task_id", ["CartPole-v0", "Acrobot-v1", "MountainCar-v0"])
def test_run_names_differ_with_the_hyperparameters(task_id: str, tmp_path: Path) -> None:
    task, home, names = get_task(task_id), Home(tmp_path), set()
    for condition in CONDITIONS.values():
        for size in SIZES.values():
            run = condition.run(task, size, 3, home)
            assert isinstance(run.nes, NES)
            names.add((run.folder.name, run.hp))
    assert len({name for name, _ in names}) == len(names)


def test_names_of_nes_runs_and_experiments_differ() -> None:
    labels = {condition.label(size) for condition in CONDITIONS.values() for size in SIZES.values()}
    assert not labels & {*NAMES}
    assert (*EXPERIMENTS, "all", "report") == NAMES


def test_only_the_paper_size_draws_agents_from_the_full_ranges() -> None:
    task, varied = get_task("CartPole-v0"), CONDITIONS["varied"]
    found = {name: varied.hyperparameters(task, size).vary_agent for name, size in SIZES.items()}
    assert found == {"smoke": "narrowed", "local": "narrowed", "paper": "all"}
    assert CONDITIONS["fixed"].hyperparameters(task, SIZES["local"]).vary_agent == "no"
    assert CONDITIONS["default"].hyperparameters(task, SIZES["local"]).vary_agent == "small"


def test_every_condition_of_an_experiment_is_known_and_has_a_colour() -> None:
    assert {*CONDITIONS, "real"} == COLOURS.keys()
    for experiment in EXPERIMENTS.values():
        for size in SIZES.values():
            assert set(experiment.runs(size)) <= set(CONDITIONS)


def test_larger_sizes_and_options_add() -> None:
    smoke, local, paper = SIZES.values()
    for name in ("ses", "agents", "real_agents", "runs", "authors_runs", "curve_ses"):
        assert getattr(smoke, name) <= getattr(local, name) <= getattr(paper, name)
    assert local.prefix == paper.prefix != smoke.prefix
    more = local.changed(ses=12, agents=None, real_agents=50)
    assert (more.ses, more.runs, more.agents, more.real_agents) == (12, 12, 10, 50)
    assert local.changed(None, None, None) == local
