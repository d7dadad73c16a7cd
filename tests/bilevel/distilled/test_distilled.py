"""The supervised baseline: off by default, and its real steps are counted."""

from functools import partial

import numpy as np
import pytest

from bilevel.distilled import BASE, Effort, advantages, distill, lessons
from bilevel.distilled.action_values import _LEARNER, ActionValues
from bilevel.hyperparameters import load_recipe
from bilevel.kernels import ddqn
from bilevel.nes import NES
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task
from bilevel.tasks.task import SCALE_STEPS
from bilevel.tasks.transitions import Transitions

#: Fast, but the SE is useless.
SMALL = Effort(random_steps=300, policy_steps=200, snapshots=2, fit_steps=20)


def test_a_distilled_start_is_a_function_of_its_seed_and_counts_its_steps(cartpole: Task) -> None:
    architecture = Architecture.of(cartpole, load_recipe("distilled", cartpole.id).se)
    one, same, other = (distill(cartpole, architecture, seed, SMALL) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.se.psi, same.se.psi)
    assert one.real_env_steps == same.real_env_steps
    assert not np.array_equal(one.se.psi, other.se.psi)
    # 500 recorded; four Q, two snapshots of each at most, ten episodes of 8 to 200 steps.
    assert 500 + 4 * 10 * 8 <= one.real_env_steps <= 500 + 8 * 10 * 200


def test_nes_begins_there_with_that_recipe_alone(
    cartpole: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bilevel.distilled.distill", partial(distill, effort=SMALL))
    state = NES(cartpole, load_recipe("distilled", cartpole.id), 3).init()
    assert state.race is None
    assert state.real_env_steps > 500
    default = NES(cartpole, load_recipe("default", cartpole.id), 3).init()
    assert default.real_env_steps == SCALE_STEPS
    assert default.race is not None


def teacher(preferred: int, score: float) -> ActionValues:
    """Values of CartPole's actions in every state: 1 for the preferred one, 0 for the other."""
    agent = ddqn.new_agent(_LEARNER, 4, 2, np.random.default_rng(0))
    agent.theta[:] = 0
    agent.theta[-2:] = [preferred == 0, preferred == 1]  # the biases of the outputs
    return ActionValues(agent, score)


def test_the_rewards_prefer_the_action_that_good_teachers_value_most(cartpole: Task) -> None:
    """Those that solve the task; if none does, the best."""
    data = Transitions.recorded(cartpole, 100, 0)
    right, left = np.where(data.actions == 1, 1.0, -1.0), np.where(data.actions == 0, 1.0, -1.0)
    bad, good = teacher(0, 100.0), teacher(1, 197.0)
    np.testing.assert_allclose(advantages(cartpole, data, [bad, good]), right, rtol=1e-3)
    np.testing.assert_allclose(advantages(cartpole, data, [good, bad]), right, rtol=1e-3)
    worse = teacher(1, 50.0)
    np.testing.assert_allclose(advantages(cartpole, data, [bad, worse]), left, rtol=1e-3)


def test_rewards_are_above_the_base_for_the_better_action(
    cartpole: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ActionValues, "learned", lambda *args: teacher(1, 200.0))
    taught = lessons(cartpole, 0, SMALL)
    assert (taught.rewards[taught.data.actions == 1] > BASE).all()
    assert (taught.rewards[taught.data.actions == 0] < BASE).all()


@pytest.mark.parametrize(("scores", "kept"), [([3.0, 9.0, 5.0], 9.0), ([3.0, 196.0, 200.0], 196.0)])
def test_the_first_snapshot_that_solves_the_task_is_kept_or_the_best(
    scores: list[float], kept: float, cartpole: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    coming = iter(scores)
    monkeypatch.setattr(
        "bilevel.distilled.action_values.real_returns",
        lambda *args: (np.array([next(coming)]), 10),
    )
    data = Transitions.recorded(cartpole, 100, 0)
    found = ActionValues.learned(cartpole, data, 0, len(scores))
    assert found.score == kept
    assert found.real_env_steps == 10 * (2 if kept == 196.0 else 3)


def test_rewarded_survival_makes_a_continuing_task(cartpole: Task, acrobot: Task) -> None:
    data = Transitions.recorded(cartpole, 200, 0)
    assert data.reward_survival
    assert data.ends.sum() > 0
    continuing, ends = data.of_continuing_task(), np.flatnonzero(data.ends[:-1])
    assert continuing.ends.sum() == 0
    np.testing.assert_array_equal(continuing.next_states[ends], data.states[ends + 1])
    others = np.flatnonzero(data.ends == 0)
    np.testing.assert_array_equal(continuing.next_states[others], data.next_states[others])
    assert not Transitions.recorded(acrobot, 200, 0).reward_survival
    more = Transitions.recorded(cartpole, 100, 1)
    for name, column in vars(data + more).items():
        np.testing.assert_array_equal(column, [*getattr(data, name), *getattr(more, name)])
