"""Natural evolution strategies over synthetic environments (paper, Algorithm 1).

    psi  <- a random SE, or the best of some fitted to the task   # bilevel.nes.start
    s, v <- 1, 0                                         # scale, velocity
    repeat n_o times:                                    # generations
        for each member i = 1 .. n_p:                    # ask: requests, in any order
            eps_i ~ N(0, sigma^2 I)
            for SE in psi, psi + s eps_i, psi - s eps_i:
                agent <- TrainAgent(fresh agent, SE)     # evaluation.evaluate
                F     <- EvaluateAgent(agent, real task)
        s   <- adapted to the share of the score that psi +- s eps keep    # tell
        v   <- momentum v + s UpdateSE({eps_i}, {F_i})
        psi <- psi + v, or back to the best psi so far, with v = 0, if psi fell far below

Every random number is derived from (run seed, generation, member), so a request is
the same whoever asks for it, and nothing random needs to be stored.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters
from bilevel.nes.generation import Generation
from bilevel.nes.start import Evaluations, Fits, StartSearch
from bilevel.nes.state import NESState
from bilevel.nes.updates import adapted_scale, update_step
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task

#: Draws one of the agents by a seed, its hyperparameters varied as one of VARIATIONS says.
AgentSampler = Callable[[tuple[AgentHyperparameters, ...], str, int], AgentHyperparameters]

# What a derived seed is for; part of the seed, so never renumber.
_PERTURBATION, _AGENT, _EVALUATION = range(1, 4)

#: Stands where a seed has its generation, for the search of the start.
_START = 2**32


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

    @property
    def start_search(self) -> StartSearch:
        """The search for the start."""
        return StartSearch(
            self.task,
            self.architecture,
            self.hp.nes,
            lambda *path: self._seed(_START, *path),
            lambda *path: self._agent(_START, *path),
        )

    def start(self, evaluate: Evaluations | None = None, fits: Fits | None = None) -> NESState:
        """The state before the first generation. `evaluate` answers the requests of the
        search for it; where there is a single candidate it is not needed. `fits` makes the
        fitted candidates, if not this process one after the other."""
        return NESState.of(self.start_search.best(evaluate, fits))

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
        nes, tried = self.hp.nes, Generation.of(self.task, self.hp.nes, results)
        scale = adapted_scale(nes, state.scale, tried.retention)
        eps = self._perturbations(state.generation)
        velocity = np.float32(scale) * update_step(nes, eps, tried.members)
        velocity += np.float32(nes.momentum) * state.velocity

        record = tried.record(
            generation=state.generation,
            psi_norm=float(np.linalg.norm(state.psi)),
            update_norm=float(np.linalg.norm(velocity)),
            std_dev=state.scale * nes.std_dev,
            generation_seconds=seconds,
            cores=cores,
            finished=finished,
        )
        current = state.as_finalist(tried.finalist(state.psi, state.generation))
        solved_reward = self.task.solved_reward
        finalists = state.with_finalist(current, solved_reward)
        psi, best = state.psi + velocity, finalists[0]
        if nes.fallback and best.surpasses(current, nes.fallback, solved_reward):
            psi, velocity = best.psi, np.zeros_like(velocity)
        solved = record.score_mean >= solved_reward
        return NESState(
            psi=psi,
            velocity=velocity,
            generation=state.generation + 1,
            scale=scale,
            solved_streak=state.solved_streak + 1 if solved else 0,
            finalists=finalists,
            records=(*state.records, record),
        )

    def _perturbations(self, generation: int) -> NDArray[np.float32]:
        architecture, sigma = self.architecture, self.hp.nes.std_dev
        return np.stack(
            [
                architecture.perturbation(self._seed(generation, member, _PERTURBATION), sigma)
                for member in range(self.hp.nes.population_size)
            ]
        )
