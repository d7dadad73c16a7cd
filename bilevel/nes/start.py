"""The choice of psi that NES starts from: random search, then crossover.

    candidates <- start_candidates random SEs
    repeat 1 + start_crossovers times:
        try every candidate once and shortly, each with an agent of its own, and the best
            of them once more
        parents <- the best by both, tried RETESTS more times by the same agents for all,
                   half of these times perturbed
        candidates <- new SEs, each of the next-state network of one parent, the reward
                      network of another and the done network of a third; the fitter a
                      parent of any round is, the more often its networks are taken
    psi <- the fittest parent

Most random SEs teach nothing, often because of one of their networks alone: what two of
them got right may go together.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import AgentHyperparameters, NESHyperparameters
from bilevel.hyperparameters.definitions import RETESTS, StartRound
from bilevel.nes.generation import judged
from bilevel.synthetic_env.architecture import NETWORKS, same_for_all
from bilevel.tasks import Task

#: An SE that may become the start: what each of its networks is initialised from.
Candidate = tuple[int, ...]

#: Answers requests, in any order.
Evaluations = Callable[[Sequence[EvaluationRequest]], Sequence[EvaluationResult]]

#: Networks are taken from a parent in proportion to this power of its fitness above the
#: task's worst.
_SELECTION = 2

#: Draws of networks for one new candidate, on average, before a round goes without.
_DRAWS = 20

# What a derived seed is for; part of the seed, so never renumber.
_INITIAL, _SCREENING, _RETEST, _CROSSOVER, _EPS = range(5)


@dataclass(frozen=True)
class StartSearch:
    """The search for a run's start; `seed` and `agent` derive the run's from what each is
    for, and which of them it is."""

    task: Task
    hp: NESHyperparameters
    seed: Callable[..., int]
    agent: Callable[..., AgentHyperparameters]

    def best(self, evaluate: Evaluations | None) -> Candidate:
        """The start; a single candidate is tried by nobody."""
        if self.hp.start_candidates == 1:
            return self._random(0)
        assert evaluate is not None
        tried: set[Candidate] = set()
        parents: dict[Candidate, float] = {}
        for number, size in enumerate(self.hp.start_rounds):
            if number == 0:
                candidates = [self._random(i) for i in range(size.screened)]
            else:
                candidates = self._crossed(parents, tried, number, size)
            tried.update(candidates)
            once = self._fitness(evaluate(self._screening(candidates, number, 0)))
            best = np.argsort(-once, kind="stable")[: size.rescreened]
            candidates = [candidates[i] for i in best]
            twice = self._fitness(evaluate(self._screening(candidates, number, 1)))
            best = np.argsort(-once[best] - twice, kind="stable")[: size.retested]
            candidates = [candidates[i] for i in best]
            fitness = self._fitness(evaluate(self._retests(candidates, number)))
            means = fitness.reshape(-1, RETESTS).mean(axis=1)
            parents.update(zip(candidates, means.tolist(), strict=True))
        return max(parents, key=parents.__getitem__)

    def _random(self, number: int) -> Candidate:
        return same_for_all(self.seed(_INITIAL, number))

    def _crossed(
        self, parents: dict[Candidate, float], tried: set[Candidate], number: int, size: StartRound
    ) -> list[Candidate]:
        """Candidates that were not tried yet, as far as there are any."""
        above = np.maximum(np.array(list(parents.values())) - self.task.worst_score, 1e-9)
        weights = above**_SELECTION / (above**_SELECTION).sum()
        rng = np.random.default_rng(self.seed(_CROSSOVER, number))
        seeds, crossed = np.array(list(parents), np.uint64), dict[Candidate, None]()
        for _ in range(_DRAWS * size.screened):
            drawn = rng.choice(len(parents), len(NETWORKS), p=weights)
            candidate = tuple(int(seeds[i, network]) for network, i in enumerate(drawn))
            if candidate not in tried:
                crossed[candidate] = None
            if len(crossed) == size.screened:
                break
        return list(crossed)

    def _screening(
        self, candidates: Sequence[Candidate], number: int, repeat: int
    ) -> list[EvaluationRequest]:
        """One evaluation of each.

        Where agents vary, each has its own: were there one for all, and that one slow to
        learn, chance would decide. It has little longer than it needs at least: most SEs
        teach nothing, and on those training would go on for long.
        """
        requests = []
        for i, candidate in enumerate(candidates):
            agent = self.agent(_SCREENING, number, repeat, i)
            least = agent.init_episodes + 3 * agent.early_out_episodes
            agent = replace(agent, max_episodes=min(least, agent.max_episodes))
            seed = self.seed(_SCREENING, number, repeat, i)
            requests.append(EvaluationRequest(i, seed, agent, start_seeds=candidate))
        return requests

    def _retests(self, candidates: Sequence[Candidate], number: int) -> list[EvaluationRequest]:
        """More of each: agents differ so much from seed to seed that one evaluation mostly
        finds the luckiest, some of them on SEs whose episodes end before anything is learned.

        Every second one is perturbed as NES will perturb it: of an SE whose neighbours teach
        nothing, NES does not see where to go.
        """
        agents = [self.agent(_RETEST, number, i) for i in range(RETESTS)]
        pairs = [(candidate, agent) for candidate in candidates for agent in agents]
        return [
            EvaluationRequest(
                i,
                self.seed(_RETEST, number, i),
                agent,
                sign=i % 2,
                perturbation_seed=self.seed(_RETEST, number, i, _EPS),
                std_dev=self.hp.std_dev,
                start_seeds=candidate,
            )
            for i, (candidate, agent) in enumerate(pairs)
        ]

    def _fitness(self, results: Sequence[EvaluationResult]) -> NDArray[np.float64]:
        return judged(self.task, self.hp, results)[2]
