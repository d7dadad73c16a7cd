"""The evolution strategy converges with every update rule, without agents and SEs."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from bilevel.evolution import RULES, EvolutionStrategy, Fitness, Genotype, SearchDistribution
from bilevel.hyperparameters import UPDATES

Objective = Callable[[NDArray[np.float64]], NDArray[np.float64]]

#: Step size of each rule for sigma 0.1 and 16 members.
ALPHA = {"nes": 1.0, "antithetic": 0.1, "paper": 0.05, "authors": 0.3}


def sphere(x: NDArray[np.float64]) -> NDArray[np.float64]:
    distance: NDArray[np.float64] = np.square(x - 1).sum(axis=-1)
    return -distance


def rosenbrock(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return -100 * (x[..., 1] - x[..., 0] ** 2) ** 2 - (1 - x[..., 0]) ** 2


def noisy_sphere(x: NDArray[np.float64]) -> NDArray[np.float64]:
    noise = np.random.default_rng(abs(hash(x.tobytes())) % 2**32).standard_normal(len(x))
    return sphere(x) + 0.3 * noise


def strategy(rule: str, averaging: float = 0.9, sigma: float = 0.1) -> EvolutionStrategy:
    alpha = RULES[rule].step_size(ALPHA[rule], sigma)
    return EvolutionStrategy(
        sigma,
        lambda fitness: RULES[rule].shape(fitness, "better-average", "mean"),
        RULES[rule].estimate,
        lambda gradient: (alpha * gradient).astype(np.float32),
        averaging,
    )


def maximize(rule: str, objective: Objective, size: int, generations: int, seed: int) -> Genotype:
    def fitness(genotypes: Genotype) -> NDArray[np.float64]:
        return objective(genotypes.astype(np.float64))

    es, members = strategy(rule), 16
    distribution = es.init(np.zeros(size, np.float32))
    for generation in range(generations):
        first = (seed * generations + generation) * members
        seeds = range(first, first + members)
        plus, minus = es.ask(distribution, seeds)
        centre = fitness(np.repeat(distribution.mean[None], 8, axis=0))
        distribution, _ = es.tell(
            distribution, seeds, Fitness(fitness(plus), fitness(minus), centre)
        )
    return distribution.average


@pytest.mark.parametrize("rule", UPDATES)
@pytest.mark.parametrize(
    ("objective", "size", "generations", "reached"),
    [(sphere, 5, 200, -0.05), (rosenbrock, 2, 1500, -0.5), (noisy_sphere, 5, 300, -0.2)],
)
def test_every_rule_converges(
    rule: str, objective: Objective, size: int, generations: int, reached: float
) -> None:
    plain = sphere if objective is noisy_sphere else objective
    for seed in (0, 1):
        found = maximize(rule, objective, size, generations, seed)
        assert plain(found.astype(np.float64)) > reached > plain(np.zeros(size))


def test_members_are_mirrored_around_the_mean_not_the_average() -> None:
    mean, average = np.ones(4, np.float32), np.zeros(4, np.float32)
    distribution = SearchDistribution(mean, average, sigma=0.5)
    plus, minus = strategy("nes").ask(distribution, [7, 8])
    np.testing.assert_allclose((plus + minus) / 2, [mean, mean], rtol=1e-6)
    np.testing.assert_allclose(plus[0], mean + 0.5 * distribution.noise(7), rtol=1e-6)
    assert not np.array_equal(distribution.noise(7), distribution.noise(8))


@pytest.mark.parametrize("kept", [0.0, 0.75])
def test_averaging(kept: float) -> None:
    es = strategy("nes", averaging=kept)
    distribution, expected = es.init(np.zeros(3, np.float32)), np.zeros(3)
    for seed in range(4):
        seeds = [2 * seed, 2 * seed + 1]
        scores = np.array([1.0, 4.0]), np.array([2.0, 3.0])
        before, (distribution, step) = distribution, es.tell(distribution, seeds, Fitness(*scores))
        np.testing.assert_allclose(distribution.mean, before.mean + step, rtol=1e-6)
        expected = kept * expected + (1 - kept) * distribution.mean
        np.testing.assert_allclose(distribution.average, expected, rtol=1e-5, atol=1e-7)
