"""Natural evolution strategies over synthetic environments (paper, Algorithm 1).

    psi <- a random SE, the best of several                     # bilevel.nes.start
    repeat n_o times:                                           # generations
        for each member i = 1 .. n_p:                           # ask
            eps_i ~ N(0, sigma^2 I)
            for SE in psi + eps_i, psi - eps_i:
                theta <- TrainAgent(fresh agent, SE)            # bilevel.evaluation
                F_i   <- EvaluateAgent(theta, real task)
        psi <- psi + alpha * gradient({F_i}, {eps_i})           # tell: bilevel.evolution

NES moves a *genotype*, which a family of SEs decodes into psi (`bilevel.synthetic_env.families`).
In the paper, and in the family `plain`, both are the same vector. Some agents also train on the
unperturbed SE. Their scores are the run's learning curve.

Two parts are not in the paper. A run that stagnates restarts from other random SEs. A run that
solves the task ends once fresh agents confirm its SE (`bilevel.nes.confirmation`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bilevel.agents import get_agent
from bilevel.errors import InvalidInput, require
from bilevel.evaluation import EvaluationRequest, EvaluationResult, comparable, scores_of
from bilevel.evolution import RULES, EvolutionStrategy, Fitness, Rule
from bilevel.evolution.shaping import COMPARING
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes.checkpoint import load_state, save_state
from bilevel.nes.confirmation import Confirming
from bilevel.nes.records import GenerationRecord
from bilevel.nes.requests import Requests, ordered_results
from bilevel.nes.start import ChoosingStart
from bilevel.nes.state import Evolving, Finished, NESState, best_finalists
from bilevel.seeds import Purpose, checked_seed, derive
from bilevel.synthetic_env import SE, Family, SEDistribution, StoredSE, family_of
from bilevel.tasks import ObservationScale, Task
from bilevel.version import __version__

#: Evaluates requests, in any order, on a distribution of SEs.
EvaluateAll = Callable[[SEDistribution, list[EvaluationRequest]], Sequence[EvaluationResult]]

#: Maximum numbers of failed confirmations that refine the step, and the average.
_FINEST_STEP, _FINEST_AVERAGE = 5, 2


@dataclass(frozen=True)
class NES:
    """An NES run as ask and tell; the caller evaluates::

        state = nes.init()
        while not state.finished:
            ses = nes.distribution(state)
            results = [evaluate(task, ses, request) for request in nes.ask(state)]
            state = nes.tell(state, results)
        best = nes.best(state)

    Raises InvalidInput for arguments of the wrong type, a negative seed, and hyperparameters that
    contradict each other or the task.
    """

    task: Task
    hp: Hyperparameters
    seed: int = 0

    def __post_init__(self) -> None:
        require(Task, self.task, "the task of NES", "as bilevel.get_task returns it")
        require(Hyperparameters, self.hp, "a recipe of NES", "as bilevel.load_recipe returns it")
        object.__setattr__(self, "seed", checked_seed(self.seed))
        nes = self.hp.nes
        if not self.rule.transforms and not nes.mirrored_sampling:
            raise InvalidInput(f"nes.update {nes.update!r} needs nes.mirrored_sampling true")
        if self.rule.transforms and nes.score_transform in COMPARING and nes.population_size < 2:
            raise InvalidInput(
                f"nes.score_transform {nes.score_transform!r} compares members: "
                f"nes.population_size must be at least 2; got {nes.population_size}"
            )
        for agent in self.hp.agents:
            get_agent(agent.agent, self.task.continuous)
        self.family(self.task.unit_scale)

    @property
    def rule(self) -> Rule:
        """The update rule."""
        return RULES[self.hp.nes.update]

    def strategy(self, refuted: int = 0) -> EvolutionStrategy:
        """Return the evolution strategy after `refuted` failed confirmations.

        Once generations solve the task, their ranks are mostly noise. Each failed confirmation
        therefore shortens the step and lengthens the memory of the average.
        """
        nes, rule = self.hp.nes, self.rule
        refinement = np.float32(nes.refinement ** min(refuted, _FINEST_STEP))
        step_size = rule.step_size(nes.step_size, nes.std_dev)
        rate = nes.refinement ** min(refuted, _FINEST_AVERAGE) * (1 - nes.averaging)
        return EvolutionStrategy(
            sigma=nes.std_dev,
            shape=lambda fitness: rule.shape(fitness, nes.score_transform, nes.ties),
            estimate=rule.estimate,
            optimize=lambda gradient: refinement * (step_size * gradient).astype(np.float32),
            averaging=1 - rate,
        )

    def family(self, scale: ObservationScale) -> Family:
        """Return the family of SEs that the run searches."""
        return family_of(self.task, self.hp.se, scale)

    @property
    def requests(self) -> Requests:
        """The evaluations of this run."""
        return Requests(self.hp, self.seed)

    @property
    def provenance(self) -> dict[str, Any]:
        """Hyperparameters, seed and version, which the run's SE files and checkpoints store."""
        hp = self.hp.to_dict()
        return {"hyperparameters": hp, "seed": self.seed, "bilevel_version": __version__}

    def run(
        self,
        evaluate_all: EvaluateAll,
        on_generation: Callable[[GenerationRecord], None] = lambda record: None,
    ) -> NESState:
        """Run to the end, and call `on_generation` with the record of each generation."""
        state = self.init()
        while not state.finished:
            generation = state.generation
            state = self.tell(state, evaluate_all(self.distribution(state), self.ask(state)))
            if state.generation > generation:
                on_generation(state.records[-1])
        return state

    def init(self, on_step: Callable[[], None] = lambda: None) -> NESState:
        """Return the first state. Except for the plain family, it takes real steps to measure the
        scale of observations, and calls `on_step` (`Task.observation_scale`)."""
        scale = self.task.unit_scale
        if self.hp.se.family != "plain":
            scale = self.task.observation_scale(derive(self.seed, Purpose.OBSERVATIONS), on_step)
        origin = self.strategy().init(np.zeros(self.family(scale).size, np.float32))
        steps = scale.real_env_steps
        cost = steps * self.task.step_seconds
        state = NESState(Evolving(), origin, scale, real_env_steps=steps, cost=cost)
        return self._restart(state, attempt=0)

    def ask(self, state: NESState) -> list[EvaluationRequest]:
        """Return the next evaluations: those of a generation, or of a round of another phase."""
        match state.phase:
            case ChoosingStart() as choosing:
                return self.requests.start(choosing, state.attempt)
            case Evolving():
                return self.requests.generation(state)
            case Confirming() as confirming:
                return self.requests.confirmation(confirming, state.generation)
            case Finished():
                return []

    def tell(self, state: NESState, results: Sequence[EvaluationResult]) -> NESState:
        """Return the state after the evaluations `ask(state)`, in any order. Raises InvalidInput
        unless there is exactly one result per request."""
        results = ordered_results(results, len(self.ask(state)))
        state = replace(
            state,
            real_env_steps=state.real_env_steps + sum(r.real_env_steps for r in results),
            cost=state.cost + sum(r.cost for r in results),
        )
        match state.phase:
            case ChoosingStart() as choosing:
                if choosing.redraws(results):
                    others = self.requests.candidates(state.attempt, choosing.draws)
                    chosen = ChoosingStart.between(others, choosing.draws + 1)
                    return replace(state, phase=chosen)
                return self._start(replace(state, phase=choosing.after(results)))
            case Confirming() as confirming:
                returns = [result.test_returns for result in comparable(results)]
                return self._judge(replace(state, phase=confirming.after(returns)))
            case _:
                return self._next_phase(self._evolve(state, results))

    def _evolve(self, state: NESState, results: Sequence[EvaluationResult]) -> NESState:
        """Take one step of the evolution strategy, and record the generation."""
        scores, centre_agents = scores_of(results), self.hp.nes.centre_agents
        centre, members = np.split(scores, [centre_agents])
        plus, *minus = members.reshape(-1, self.hp.nes.population_size)
        fitness = Fitness(plus, minus[0] if minus else None, centre)
        seeds = self.requests.perturbations(state)
        search, step = self.strategy(state.refuted).tell(state.search, seeds, fitness)
        record = GenerationRecord.of(
            results,
            centre_agents,
            self.task.solved_reward,
            generation=state.generation,
            attempt=state.attempt,
            real_env_steps=state.real_env_steps,
            cost=state.cost,
            psi_norm=float(np.linalg.norm(self.distribution(state).centre.psi)),
            update_norm=float(np.linalg.norm(step)),
        )
        finalists = best_finalists(state.finalists, state.search.average, record)
        records, generation = (*state.records, record), state.generation + 1
        return replace(
            state, search=search, generation=generation, finalists=finalists, records=records
        )

    def _restart(self, state: NESState, attempt: int) -> NESState:
        """Start an attempt with the choice of a start."""
        phase, now = ChoosingStart.between(self.requests.candidates(attempt)), state.generation
        state = replace(state, phase=phase, attempt=attempt, attempt_start=now, last_judged=now)
        return self._start(replace(state, refuted=0))

    def _start(self, state: NESState) -> NESState:
        """Evolve the chosen SE, unless several candidates are left."""
        assert isinstance(state.phase, ChoosingStart)
        seed = state.phase.halving.winner
        if seed is None:
            return state
        genotype = self.family(state.scale).initialize(np.random.default_rng(seed))
        return replace(state, phase=Evolving(), search=self.strategy().init(genotype))

    def _next_phase(self, state: NESState) -> NESState:
        """Choose the phase after a generation."""
        nes, solved_reward = self.hp.nes, self.task.solved_reward
        if state.solved(nes, solved_reward):
            if nes.confirming_agents:
                return replace(state, phase=Confirming(nes.confirming_agents, state.refuted))
            return replace(state, phase=Finished())
        if state.generation >= nes.generations:
            return replace(state, phase=Finished())
        if state.stagnates(nes, solved_reward):
            return self._restart(state, state.attempt + 1)
        return replace(state, phase=Evolving())

    def _judge(self, state: NESState) -> NESState:
        """End the run if the SE is confirmed, continue it if the SE is rejected."""
        assert isinstance(state.phase, Confirming)
        verdict = state.phase.verdict(self.task.solved_reward)
        if verdict is None:
            return state
        state = replace(state, last_judged=state.generation, refuted=state.refuted + (not verdict))
        if verdict or state.generation >= self.hp.nes.generations:
            return replace(state, phase=Finished(confirmed=verdict))
        return replace(state, phase=Evolving())

    def distribution(self, state: NESState) -> SEDistribution:
        """Return the search distribution over SEs, from which requests draw theirs."""
        return SEDistribution(self.family(state.scale), state.search)

    def current(self, state: NESState) -> StoredSE:
        """Return the unperturbed SE after the last step."""
        info = {"generation": state.generation, "confirmed": state.confirmed}
        return self._stored(state, self.distribution(state).centre, info)

    def candidates(self, state: NESState) -> list[StoredSE]:
        """Return the SEs whose agents scored highest, best first."""
        names = ("generation", "score_mean", "perturbed_score_mean", "train_steps_mean")
        ses = []
        for finalist in state.finalists:
            record = vars(state.records[finalist.generation])
            info = {name: record[name] for name in names} | {"confirmed": False}
            ses.append(self._stored(state, self.distribution(state).at(finalist.genotype), info))
        return ses

    def best(self, state: NESState) -> StoredSE:
        """Return the current SE if it is confirmed, else the one whose agents scored highest."""
        if state.confirmed or not state.finalists:
            return self.current(state)
        return self.candidates(state)[0]

    def _stored(self, state: NESState, se: SE, info: dict[str, Any]) -> StoredSE:
        info = {**self.provenance, "real_env_steps": state.real_env_steps, **info}
        return StoredSE(se, self.task.id, self.task.step_limit, self.task.solved_reward, info)

    def save(self, state: NESState, path: Path) -> None:
        """Write a checkpoint durably. Raises StorageFailure."""
        save_state(state, path, self.task, self.provenance)

    def load(self, path: Path) -> NESState:
        """Read a checkpoint of this run; a run that was out of generations continues if
        `nes.generations` has grown. Raises the errors of `load_state`."""
        state = load_state(path, self.task, self.provenance)
        if state.search.mean.size != self.family(state.scale).size:
            raise InvalidInput(f"damaged checkpoint {str(path)!r}: its genotype has another length")
        between_generations = isinstance(state.phase, Evolving | Finished) and not state.confirmed
        return self._next_phase(state) if between_generations else state
