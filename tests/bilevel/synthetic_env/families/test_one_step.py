"""The one-step family."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from bilevel import InvalidInput
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SE, StoredSE, family_of
from bilevel.synthetic_env.torch_module import SEModule
from bilevel.tasks import ObservationScale, Task

TASK = Task("Wide-v0", 5, 3, 10, 1.0, 0.0, continuous=True)
SCALE = ObservationScale(np.arange(5, dtype=np.float32), np.full(5, 3, np.float32), 0)


def random_se(seed: int, hidden_size: int = 6) -> StoredSE:
    hp = replace(load_recipe("default", TASK).se, hidden_size=hidden_size)
    family = family_of(TASK, hp, SCALE)
    genotype = family.initialize(np.random.default_rng(seed))
    assert genotype.shape == (family.size,)
    return StoredSE(SE(family.architecture, family.psi(genotype)), TASK.id, 10, 1.0)


def test_every_weight_of_the_reward_network_is_a_gene() -> None:
    family = family_of(TASK, load_recipe("default", TASK).se, SCALE)
    _, reward, _ = family.architecture.networks
    assert family.size == reward.parameter_count
    genotype = family.initialize(np.random.default_rng(0))
    start = family.architecture.split(family.psi(genotype))[1]
    moved = family.architecture.split(family.psi(genotype + 1))[1]
    assert (start != moved).all()


@pytest.mark.parametrize("seed", range(5))
def test_random_ses_have_a_best_action_that_depends_on_the_state(seed: int) -> None:
    """Each action dimension counts on its own: the best value does not depend on the others."""
    se, rng = random_se(seed), np.random.default_rng(seed)
    states = se.se.initial_states(rng, 40)
    values = np.linspace(-1, 1, 41, dtype=np.float32)
    best = np.zeros((2, 40, 3))
    for others in range(2):
        for dimension in range(3):
            actions = np.tile(rng.uniform(-1, 1, 3).astype(np.float32), (40, 41, 1))
            actions[..., dimension] = values
            inputs = torch.from_numpy(states[:, None].repeat(41, axis=1)), torch.from_numpy(actions)
            rewards = SEModule(se)(*inputs)[1].numpy()
            assert (rewards <= 1e-3).all()
            best[others, :, dimension] = values[rewards.argmax(axis=1)]
    np.testing.assert_allclose(best[0], best[1], atol=0.06)
    assert (np.ptp(best[0], axis=0) > 1).all()


@pytest.mark.parametrize(("asked", "used"), [(1, 6), (6, 6), (7, 8), (64, 64)])
def test_units_form_pairs_for_each_action_dimension(asked: int, used: int) -> None:
    assert random_se(0, hidden_size=asked).architecture.hidden_size == used


def test_episodes_have_one_step_and_start_in_own_states() -> None:
    se = random_se(0)
    assert se.se.architecture.one_step
    states = se.se.initial_states(np.random.default_rng(0), 20_000)
    np.testing.assert_allclose(states.mean(axis=0), SCALE.mean, atol=0.1)
    np.testing.assert_allclose(states.std(axis=0), SCALE.deviation, rtol=0.05)
    _, _, done = SEModule(se)(torch.from_numpy(states), torch.zeros(20_000, 3))
    assert (done.numpy() == 1).all()


def test_unsupported_networks_and_actions() -> None:
    hp = load_recipe("default", TASK).se
    with pytest.raises(InvalidInput, match=r"'one-step' needs se.hidden_layers 1"):
        family_of(TASK, replace(hp, hidden_layers=2), SCALE)
    with pytest.raises(InvalidInput, match="'exogenous' needs discrete actions"):
        family_of(TASK, replace(hp, family="exogenous"), SCALE)
