from dataclasses import replace

import pytest

import bilevel.tasks.task
from benchmarks.nes import run, scale
from bilevel.hyperparameters import Hyperparameters
from bilevel.tasks import Task


@pytest.fixture
def one_generation(small_hp: Hyperparameters) -> Hyperparameters:
    return replace(small_hp, nes=replace(small_hp.nes, generations=1))


def test_whether_a_run_solves_the_task_follows_from_its_score(
    one_generation: Hyperparameters, cartpole: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "FINAL_AGENTS", 2)
    easy, hard = (replace(cartpole, solved_reward=reward) for reward in (1.0, 201.0))
    assert run.run_nes(easy, one_generation, 3)["solved"]
    assert not run.run_nes(hard, one_generation, 3)["solved"]


def test_the_scale_is_measured_over_so_many_steps(
    one_generation: Hyperparameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "FINAL_AGENTS", 1)
    monkeypatch.setattr(scale, "load_recipe", lambda *_: one_generation)
    for name in ("SCALE_STEPS", "GYMNASIUM_SCALE_STEPS"):  # put back at the end
        monkeypatch.setattr(bilevel.tasks.task, name, getattr(bilevel.tasks.task, name))
    few, many, again = (scale.measured("CartPole-v0", steps, 5) for steps in (30, 3000, 30))
    assert few == again
    assert (few["steps"], few["seed"], len(few["mean"])) == (30, 5, 4)
    assert max(map(abs, few["mean"])) > max(map(abs, many["mean"]))
