"""The search distribution over SEs."""

import numpy as np
import pytest

from bilevel.hyperparameters import load_recipe
from bilevel.synthetic_env import SEDistribution, coordinates
from bilevel.tasks import get_task


@pytest.fixture(params=["default", "paper"])  # exogenous and plain coordinates
def around(request: pytest.FixtureRequest) -> SEDistribution:
    """A distribution around a random SE, wider in some coordinates than in others."""
    task = get_task("CartPole-v0")
    hp = load_recipe(request.param, task.id).se
    space = coordinates(task, hp, task.observation_scale(1))
    rng = np.random.default_rng(0)
    mean, std_dev = space.initialize(rng), np.linspace(0.1, 0.2, space.size, dtype=np.float32)
    return SEDistribution(space, mean, std_dev, mean)


def test_perturbations_are_mirrored_and_reproducible(around: SEDistribution) -> None:
    assert around.coordinates.size == around.mean.size
    noise = around.noise(7)
    np.testing.assert_array_equal(noise, around.noise(7))
    assert not np.array_equal(noise, around.noise(8))
    for sign in (1, -1):
        there = around.at(around.mean + sign * around.std_dev * noise).psi
        np.testing.assert_allclose(around.perturbed(7, sign).psi, there, rtol=1e-5, atol=1e-6)
    assert not np.array_equal(around.perturbed(7, -1).psi, around.perturbed(7, 1).psi)


def test_the_centre_is_the_average_of_past_means(around: SEDistribution) -> None:
    steps = np.ones((2, around.mean.size), np.float32)
    without, kept = around, around
    for step in steps:
        without, kept = without.moved(step, 0.0), kept.moved(step, 0.75)
    np.testing.assert_allclose(without.mean, around.mean + 2, rtol=1e-5)
    np.testing.assert_array_equal(kept.mean, without.mean)
    np.testing.assert_array_equal(without.average, without.mean)
    # 0.75 (0.75 m + 0.25 (m + 1)) + 0.25 (m + 2)
    np.testing.assert_allclose(kept.average, around.mean + 0.6875, rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(kept.centre.psi, kept.at(kept.average).psi)


def test_a_new_place_has_nothing_to_average(around: SEDistribution) -> None:
    placed = around.moved(np.ones_like(around.mean), 0.75).placed(around.mean)
    np.testing.assert_array_equal(placed.mean, around.mean)
    np.testing.assert_array_equal(placed.average, around.mean)
    np.testing.assert_array_equal(placed.std_dev, around.std_dev)
