"""The choice of psi that NES starts from.

random    the best of so many random initialisations, as in the paper if it is one: each is
          tried once and shortly by an agent of its own, the best of them once more, and the
          best by both RETESTS more times by the same agents for all, half of these times
          perturbed
fitted    the best of so many SEs fitted to the real task (`bilevel.synthetic_env.fitted`),
          each tried by the same FIT_TESTS agents

Most random SEs teach nothing. Most fitted ones teach something, and every agent the same:
NES then begins where scores tell SEs, not agents, apart.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import AgentHyperparameters, NESHyperparameters
from bilevel.hyperparameters.definitions import FIT_TESTS, RETESTS
from bilevel.nes.fitness import judged, worth_of
from bilevel.synthetic_env import Architecture
from bilevel.synthetic_env.fitted import fitted_psi
from bilevel.tasks import Task

Psi = NDArray[np.float32]

#: Answers requests, in any order; on SEs that they initialise, or on a psi (P,).
Evaluations = Callable[[Psi | None, Sequence[EvaluationRequest]], Sequence[EvaluationResult]]

#: The psi (P,) fitted by each of these seeds, in their order.
Fits = Callable[[Sequence[int]], Sequence[Psi]]

# What a derived seed is for; part of the seed, so never renumber.
_INITIAL, _SCREENING, _RETEST, _EPS, _FITTED = range(5)


@dataclass(frozen=True)
class StartSearch:
    """The search for a run's start; `seed` and `agent` derive the run's from what each is
    for, and which of them it is."""

    task: Task
    architecture: Architecture
    hp: NESHyperparameters
    seed: Callable[..., int]
    agent: Callable[..., AgentHyperparameters]

    @property
    def fit_seeds(self) -> list[int]:
        """Of the fitted candidates."""
        return [self.seed(_FITTED, number) for number in range(self.hp.start_candidates)]

    def best(self, evaluate: Evaluations | None, fits: Fits | None) -> Psi:
        """The start (P,); a single candidate is tried by nobody, and fitted here, as all are
        without `fits`."""
        if self.hp.start == "fitted":
            return self._best_fitted(evaluate, fits)
        best = self.seed(_INITIAL, 0)
        if self.hp.start_candidates > 1:
            assert evaluate is not None
            best = self._best_random(evaluate)
        return self.architecture.initialize(np.random.default_rng(best))

    def _best_fitted(self, evaluate: Evaluations | None, fits: Fits | None) -> Psi:
        seeds = self.fit_seeds
        if len(seeds) == 1:
            return self._fitted_here(seeds)[0]
        assert evaluate is not None
        requests = [
            EvaluationRequest(i, self.seed(_RETEST, i), self.agent(_RETEST, i))
            for i in range(FIT_TESTS)
        ]
        fitted, worths = (fits or self._fitted_here)(seeds), []
        for psi in fitted:
            _, scores, fit = judged(self.task, self.hp, evaluate(psi, requests))
            worths.append(worth_of(scores.mean(), fit.mean(), self.task.solved_reward))
        return fitted[worths.index(max(worths))]

    def _fitted_here(self, seeds: Sequence[int]) -> list[Psi]:
        return [fitted_psi(self.task, self.architecture, seed) for seed in seeds]

    def _best_random(self, evaluate: Evaluations) -> int:
        """The seed of the best initialisation."""
        size = self.hp.start_sizes
        seeds = [self.seed(_INITIAL, i) for i in range(size.screened)]
        once = self._fitness(evaluate(None, self._screening(seeds, 0)))
        best = np.argsort(-once, kind="stable")[: size.rescreened]
        seeds = [seeds[i] for i in best]
        twice = self._fitness(evaluate(None, self._screening(seeds, 1)))
        best = np.argsort(-once[best] - twice, kind="stable")[: size.retested]
        seeds = [seeds[i] for i in best]
        fitness = self._fitness(evaluate(None, self._retests(seeds)))
        return seeds[int(np.argmax(fitness.reshape(-1, RETESTS).mean(axis=1)))]

    def _screening(self, seeds: Sequence[int], repeat: int) -> list[EvaluationRequest]:
        """One evaluation of each.

        Where agents vary, each has its own: were there one for all, and that one slow to
        learn, chance would decide. It has little longer than it needs at least: most SEs
        teach nothing, and on those training would go on for long.
        """
        requests = []
        for i, start_seed in enumerate(seeds):
            agent = self.agent(_SCREENING, repeat, i)
            least = agent.init_episodes + 3 * agent.early_out_episodes
            agent = replace(agent, max_episodes=min(least, agent.max_episodes))
            seed = self.seed(_SCREENING, repeat, i)
            requests.append(EvaluationRequest(i, seed, agent, start_seed=start_seed))
        return requests

    def _retests(self, seeds: Sequence[int]) -> list[EvaluationRequest]:
        """More of each: agents differ so much from seed to seed that one evaluation mostly
        finds the luckiest, some of them on SEs whose episodes end before anything is learned.

        Every second one is perturbed as NES will perturb it: of an SE whose neighbours teach
        nothing, NES does not see where to go.
        """
        agents = [self.agent(_RETEST, i) for i in range(RETESTS)]
        pairs = [(seed, agent) for seed in seeds for agent in agents]
        return [
            EvaluationRequest(
                i,
                self.seed(_RETEST, i),
                agent,
                sign=i % 2,
                perturbation_seed=self.seed(_RETEST, i, _EPS),
                std_dev=self.hp.std_dev,
                start_seed=seed,
            )
            for i, (seed, agent) in enumerate(pairs)
        ]

    def _fitness(self, results: Sequence[EvaluationResult]) -> NDArray[np.float64]:
        return judged(self.task, self.hp, results)[2]
