"""The search distribution over SEs."""

import numpy as np
import pytest

from bilevel.evolution import SearchDistribution
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import SEDistribution, family_of
from bilevel.tasks import get_task


@pytest.mark.parametrize("recipe", ["default", "paper"])  # exogenous and plain
def test_members_decode_perturbed_genotypes(recipe: str) -> None:
    task = get_task("CartPole-v0")
    family = family_of(task, load_recipe(recipe, task.id).se, task.observation_scale(1))
    mean, average = (family.initialize(np.random.default_rng(seed)) for seed in (0, 1))
    ses = SEDistribution(family, SearchDistribution(mean, average, sigma=0.1))
    for sign in (1, -1):
        expected = ses.at(mean + sign * np.float32(0.1) * ses.search.noise(7)).psi
        np.testing.assert_allclose(ses.perturbed(7, sign).psi, expected, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(ses.centre.psi, family.psi(average))
    np.testing.assert_array_equal(ses.random(1).psi, family.psi(average))
