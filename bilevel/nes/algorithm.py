"""Natural evolution strategies over synthetic environments (paper, Algorithm 1).

    psi  <- the best of start_candidates random initialisations: one short evaluation
            each, then RETESTS more of the best of them
    s, v <- 1, 0                                         # scale, velocity
    repeat n_o times:                                    # generations
        for each member i = 1 .. n_p:                    # ask: requests, in any order
            eps_i ~ N(0, sigma^2 I)
            for SE in psi, psi + s eps_i, psi - s eps_i:
                agent <- TrainAgent(fresh agent, SE)     # evaluation.evaluate
                F     <- EvaluateAgent(agent, real task)
        s   <- adapted to the share of the score that psi +- s eps keep    # tell
        v   <- momentum v + s UpdateSE({eps_i}, {F_i})
        psi <- psi + v, or back to the fittest psi so far, with v = 0, if psi fell far below

Every random number is derived from (run seed, generation, member), so a request is
the same whoever asks for it, and nothing random needs to be stored.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import (
    AgentHyperparameters,
    Hyperparameters,
    NESHyperparameters,
)
from bilevel.hyperparameters.definitions import RETEST_ONE_IN, RETESTS
from bilevel.nes.state import Finalist, GenerationRecord, NESState
from bilevel.nes.updates import MemberScores, adapted_scale, update_step
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task

#: Draws one of the agents by a seed, its hyperparameters varied as one of VARIATIONS says.
AgentSampler = Callable[[tuple[AgentHyperparameters, ...], str, int], AgentHyperparameters]

# What a derived seed is for; part of the seed, so never renumber.
_START, _PERTURBATION, _AGENT, _EVALUATION = range(4)


@dataclass(frozen=True)
class NES:
    """An NES run as ask and tell; it evaluates nothing itself.

    `sample_agent` is called once a member if the hyperparameters ask for varied or
    for several agents; a mirrored pair shares the draw.
    """

    task: Task
    hp: Hyperparameters
    seed: int
    sample_agent: AgentSampler | None = None

    @property
    def architecture(self) -> Architecture:
        """Shape of the SEs."""
        return Architecture.of(self.task, self.hp.se)

    def _seed(self, *path: int) -> int:
        word = np.random.SeedSequence([self.seed, *path]).generate_state(1, np.uint64)[0]
        return int(word)

    def screening_requests(self) -> list[EvaluationRequest]:
        """One evaluation of each start candidate; none if there is one alone.

        Where agents vary, each has its own: were there one for all, and that one slow to
        learn, chance would decide. It has little longer than it needs at least: most SEs
        teach nothing, and on those training would go on for long.
        """
        candidates = self.hp.nes.start_candidates
        if candidates == 1:
            return []
        agents = [self._agent(_START, i, 0) for i in range(candidates)]
        short = [agent.init_episodes + 3 * agent.early_out_episodes for agent in agents]
        return [
            self._start_request(i, i, 0, replace(agent, max_episodes=min(most, agent.max_episodes)))
            for i, (agent, most) in enumerate(zip(agents, short, strict=True))
        ]

    def retest_requests(self, screened: Sequence[EvaluationResult]) -> list[EvaluationRequest]:
        """Further evaluations of the candidates that screened best: agents differ so
        much from seed to seed that one evaluation mostly finds the luckiest."""
        agents = [self._agent(_START, 1 + i) for i in range(RETESTS)]  # the same for all
        return [
            self._start_request(place * RETESTS + i, candidate, 1 + i, agent)
            for place, candidate in enumerate(self._screened_best(screened))
            for i, agent in enumerate(agents)
        ]

    def start(
        self,
        screened: Sequence[EvaluationResult] = (),
        retested: Sequence[EvaluationResult] = (),
    ) -> NESState:
        """The state before the first generation."""
        best = 0
        if retested:
            fitness = self._fitness(retested).reshape(-1, RETESTS).mean(axis=1)
            best = self._screened_best(screened)[int(fitness.argmax())]
        rng = np.random.default_rng(self._seed(_START, best))
        psi = self.architecture.initialize(rng)
        return NESState(psi, np.zeros_like(psi))

    def _screened_best(self, screened: Sequence[EvaluationResult]) -> list[int]:
        keep = math.ceil(len(screened) / RETEST_ONE_IN)
        return [int(i) for i in np.argsort(-self._fitness(screened), kind="stable")[:keep]]

    def _start_request(
        self, index: int, candidate: int, repeat: int, agent: AgentHyperparameters
    ) -> EvaluationRequest:
        return EvaluationRequest(
            index=index,
            seed=self._seed(_START, candidate, _EVALUATION, repeat),
            agent=agent,
            start_seed=self._seed(_START, candidate),
        )

    def ask(self, state: NESState) -> list[EvaluationRequest]:
        """The evaluations of the next generation: n_p on psi itself, n_p on
        psi + eps_i, and with mirrored sampling n_p on psi - eps_i."""
        agents = [self._agent(state.generation, i) for i in range(self.hp.nes.population_size)]
        requests: list[EvaluationRequest] = []
        for sign in (0, 1, -1) if self.hp.nes.mirrored_sampling else (0, 1):
            for member, agent in enumerate(agents):
                index = len(requests)
                paired = self.hp.nes.update == "paired" and sign == -1
                trial = index - self.hp.nes.population_size if paired else index
                requests.append(
                    EvaluationRequest(
                        index=index,
                        seed=self._seed(state.generation, trial, _EVALUATION),
                        agent=agent,
                        sign=sign,
                        perturbation_seed=self._seed(state.generation, member, _PERTURBATION),
                        std_dev=state.scale * self.hp.nes.std_dev,
                    )
                )
        return requests

    def _agent(self, *path: int) -> AgentHyperparameters:
        agents, vary = self.hp.agents, self.hp.vary_agent
        agent = agents[0]
        if vary != "no" or len(agents) > 1:
            assert self.sample_agent is not None
            agent = self.sample_agent(agents, vary, self._seed(*path, _AGENT))
        return replace(agent, max_episodes=min(agent.max_episodes, self.hp.nes.max_episodes))

    def tell(
        self,
        state: NESState,
        results: Sequence[EvaluationResult],
        seconds: float,
        finished: float,
        cores: int = 1,
    ) -> NESState:
        """The state after the generation that `ask(state)` asked for; its record is
        the last of `records`. `results` may come in any order; they took `seconds` on
        so many cores, until the unix time `finished`."""
        ordered = sorted(results, key=lambda result: result.index)
        nes = self.hp.nes
        scores = self._scores(results).reshape(-1, nes.population_size)
        fitness = self._fitness(results).reshape(-1, nes.population_size)
        members = MemberScores(fitness[0], fitness[1], fitness[2] if len(fitness) == 3 else None)
        kept = self._retention(scores)
        scale = adapted_scale(nes, state.scale, kept)
        eps = self._perturbations(state.generation)
        velocity = np.float32(scale) * update_step(nes, eps, members)
        velocity += np.float32(nes.momentum) * state.velocity

        centre = ordered[: nes.population_size]
        kernel_seconds = max(sum(r.seconds for r in ordered), 1e-9)
        record = GenerationRecord(
            generation=state.generation,
            score_mean=float(scores[0].mean()),
            score_std=float(scores[0].std()),
            score_best=float(scores[0].max()),
            perturbed_score_mean=float(scores[1:].mean()),
            fitness_mean=float(members.centre.mean()),
            train_steps_mean=float(np.mean([r.train_steps for r in centre])),
            train_episodes_mean=float(np.mean([r.train_episodes for r in centre])),
            solved_fraction=float((scores[0] >= self.task.solved_reward).mean()),
            non_finite=sum(not (r.finite and math.isfinite(r.score)) for r in ordered),
            psi_norm=float(np.linalg.norm(state.psi)),
            update_norm=float(np.linalg.norm(velocity)),
            std_dev=state.scale * nes.std_dev,
            retention=kept,
            env_steps_per_second=sum(r.train_steps for r in ordered) / kernel_seconds,
            generation_seconds=seconds,
            core_utilisation=kernel_seconds / max(seconds * cores, 1e-9),
            finished=finished,
        )
        tried = state.as_finalist(
            Finalist(
                state.psi,
                state.generation,
                record.score_mean,
                record.fitness_mean,
                record.perturbed_score_mean,
                _standard_error(members.centre),
            )
        )
        finalists = state.with_finalist(tried)
        psi, fittest = state.psi + velocity, finalists[0]
        if nes.fallback and fittest.surpasses(tried, nes.fallback):
            psi, velocity = fittest.psi, np.zeros_like(velocity)
        solved = record.score_mean >= self.task.solved_reward
        return NESState(
            psi=psi,
            velocity=velocity,
            generation=state.generation + 1,
            scale=scale,
            solved_streak=state.solved_streak + 1 if solved else 0,
            finalists=finalists,
            records=(*state.records, record),
        )

    def _scores(self, results: Sequence[EvaluationResult]) -> NDArray[np.float64]:
        """Scores (n,) in the order of the requests; one that is not finite is the
        task's worst."""
        scores = np.array([r.score for r in sorted(results, key=lambda r: r.index)])
        return np.where(np.isfinite(scores), scores, self.task.worst_score)

    def _retention(self, scores: NDArray[np.float64]) -> float:
        """The share of psi's score above the task's worst that its perturbations keep, from
        the scores of a generation, psi's own first; 1 if there is nothing to keep."""
        centre, perturbed = scores[0].mean(), scores[1:].mean()
        worst = self.task.worst_score
        if centre <= worst:
            return 1.0
        return float(np.clip((perturbed - worst) / (centre - worst), 0.0, 1.0))

    def _fitness(self, results: Sequence[EvaluationResult]) -> NDArray[np.float64]:
        """Of the results in the order of the requests, (n,)."""
        steps = np.array([r.train_steps for r in sorted(results, key=lambda r: r.index)])
        return fitness(self.task, self.hp.nes, self._scores(results), steps)

    def _perturbations(self, generation: int) -> NDArray[np.float32]:
        architecture, sigma = self.architecture, self.hp.nes.std_dev
        return np.stack(
            [
                architecture.perturbation(self._seed(generation, member, _PERTURBATION), sigma)
                for member in range(self.hp.nes.population_size)
            ]
        )


def fitness(
    task: Task,
    hp: NESHyperparameters,
    scores: NDArray[np.float64],
    train_steps: NDArray[np.int64],
) -> NDArray[np.float64]:
    """What NES maximises, (n,): the scores (n,), less a share of what each is above the
    task's worst for every 1000 of the train steps (n,).

    A share, not an amount: agents that fail soon shall not be fitter than those that need
    long to learn something.
    """
    left = np.maximum(1 - hp.step_price * train_steps / 1000, 0.0)
    fit: NDArray[np.float64] = task.worst_score + (scores - task.worst_score) * left
    return fit


def _standard_error(values: NDArray[np.float64]) -> float:
    """Of the mean; infinite for a single value."""
    return float(values.std(ddof=1) / np.sqrt(values.size)) if values.size > 1 else math.inf
