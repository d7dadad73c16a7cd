"""The supervised baseline: off by default, and its real steps are counted."""

from functools import partial

import numpy as np
import pytest

from bilevel.distilled import Effort, distill
from bilevel.hyperparameters import load_recipe
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
