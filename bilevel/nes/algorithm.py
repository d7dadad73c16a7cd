"""Natural evolution strategies over synthetic environments (paper, Algorithm 1).

    theta <- a random SE, the best of some                      # bilevel.nes.start
    repeat n_o times:                                           # generations
        for each member i = 1 .. n_p:                           # ask: requests, in any order
            eps_i ~ N(0, sigma^2 I)
            for SE in theta + eps_i, theta - eps_i:
                agent <- TrainAgent(fresh agent, SE)            # evaluation.evaluate
                F     <- EvaluateAgent(agent, real task)
        theta <- theta + UpdateSE({eps_i}, {F_i})               # tell; bilevel.nes.rules

Beside the members some agents are trained on the unperturbed SE, whose scores are the run's
learning curve: on theta itself, or, with `nes.averaging`, on a moving average of it. theta are
the coordinates of psi (`bilevel.synthetic_env.coordinates`); in the paper they are psi itself.

Two things are not in the paper. A run that does not get going begins again from other random SEs,
and one that solves the task is confirmed by fresh agents before it ends (bilevel.nes.confirmation).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bilevel.errors import InvalidInput, require
from bilevel.evaluation import EvaluationRequest, EvaluationResult, scores_of
from bilevel.hyperparameters import Hyperparameters
from bilevel.nes.archive import Finalist, admitted
from bilevel.nes.checkpoint import load_state
from bilevel.nes.confirmation import Confirmation
from bilevel.nes.records import GenerationRecord
from bilevel.nes.requests import Requests
from bilevel.nes.rules import RULES, MemberScores, UpdateRule
from bilevel.nes.start import StartRace
from bilevel.nes.state import NESState
from bilevel.nes.steps import StepControl
from bilevel.nes.transforms import COMPARING
from bilevel.seeds import Purpose, checked_seed, derive
from bilevel.synthetic_env import SEDistribution, coordinates
from bilevel.tasks import Task
from bilevel.version import __version__

#: Evaluates requests, in any order, on a distribution of SEs.
EvaluateAll = Callable[[SEDistribution, list[EvaluationRequest]], Sequence[EvaluationResult]]


@dataclass(frozen=True)
class NES:
    """An NES run as ask and tell; it evaluates nothing itself::

        state = nes.init()
        while not state.finished:
            results = [evaluate(task, state.se, request) for request in nes.ask(state)]
            state = nes.tell(state, results)

    Raises InvalidInput for values of other kinds, a negative seed, and hyperparameters that do not
    fit together, or not the task.
    """

    task: Task
    hp: Hyperparameters
    seed: int = 0

    def __post_init__(self) -> None:
        require(Task, self.task, "the task of NES", "as bilevel.get_task returns it")
        require(Hyperparameters, self.hp, "a recipe of NES", "as bilevel.load_recipe returns it")
        object.__setattr__(self, "seed", checked_seed(self.seed))
        if self.rule.needs_pairs and not self.hp.nes.mirrored_sampling:
            raise InvalidInput(
                f"nes.update {self.hp.nes.update!r} needs nes.mirrored_sampling true; got false"
            )
        nes = self.hp.nes
        if self.rule.transforms and nes.score_transform in COMPARING and nes.population_size < 2:
            raise InvalidInput(
                f"nes.score_transform {nes.score_transform!r} compares members: "
                f"nes.population_size must be at least 2; got {nes.population_size}"
            )
        coordinates(self.task, self.hp.se, self.task.unit_scale)

    @property
    def rule(self) -> UpdateRule:
        """The update rule."""
        return RULES[self.hp.nes.update]

    @property
    def requests(self) -> Requests:
        """The evaluations of this run."""
        return Requests(self.hp, self.seed)

    @property
    def provenance(self) -> dict[str, Any]:
        """Hyperparameters, seed and version, which the run's SE files hold."""
        hp = self.hp.to_dict()
        return {"hyperparameters": hp, "seed": self.seed, "bilevel_version": __version__}

    # -- the loop ------------------------------------------------------------------

    def run(
        self,
        evaluate_all: EvaluateAll,
        on_generation: Callable[[GenerationRecord], None] = lambda record: None,
    ) -> NESState:
        """Run to the end; `on_generation` is called with the record of each generation."""
        state = self.init()
        while not state.finished:
            generation = state.generation
            state = self.tell(state, evaluate_all(state.se, self.ask(state)))
            if state.generation > generation:
                on_generation(state.records[-1])
        return state

    # -- init ----------------------------------------------------------------------

    def init(self) -> NESState:
        """The state before anything is evaluated.

        It may make real steps for the scale of observations (`Task.observation_scale`); a
        distilled start takes seconds and many more of them.
        """
        scale, real_steps = self.task.unit_scale, 0
        if self.hp.se.structure == "exogenous":
            scale = self.task.observation_scale(derive(self.seed, Purpose.OBSERVATIONS))
            real_steps = scale.real_env_steps
        space = coordinates(self.task, self.hp.se, scale)
        sigma = np.full(space.size, self.hp.nes.std_dev, np.float32)
        if self.hp.nes.start == "distilled":
            from bilevel.distilled import distill

            start = distill(self.task, space.architecture, derive(self.seed, Purpose.DISTILLED))
            return NESState(
                self.task,
                SEDistribution(space, start.se.psi, sigma, start.se.psi),
                scale,
                self.provenance,
                real_env_steps=real_steps + start.real_env_steps,
            )
        zero = np.zeros(space.size, np.float32)
        origin = SEDistribution(space, zero, sigma, zero)
        state = NESState(self.task, origin, scale, self.provenance, real_env_steps=real_steps)
        return self._started(state, attempt=0)

    def load(self, path: Path) -> NESState:
        """Read a checkpoint of this run (`bilevel.nes.checkpoint`); a run that was out of
        generations goes on if there are more now. Raises InvalidInput, OtherVersion and
        StorageFailure as `load_state` does."""
        state = load_state(path, self.task, self.hp.se, self.provenance)
        return self._restarted(self._ended(state))

    def _started(self, state: NESState, attempt: int) -> NESState:
        """Begin an attempt: choose its start among random SEs, or take the only one."""
        race = StartRace.of(self.requests.candidates(attempt))
        state = replace(
            state,
            attempt=attempt,
            attempt_began=state.generation,
            judged=state.generation,
            race=race,
            refuted=0,
        )
        return self._at_winner(state)

    def _at_winner(self, state: NESState) -> NESState:
        """The state at the chosen start, or unchanged while several candidates are left."""
        assert state.race is not None
        winner = state.race.winner
        if winner is None:
            return state
        space = state.se.coordinates
        theta = space.initialize(np.random.default_rng(winner))
        return replace(state, se=state.se.placed(theta), race=None)

    # -- ask -----------------------------------------------------------------------

    def ask(self, state: NESState) -> list[EvaluationRequest]:
        """The evaluations that come next: a round of the choice of a start or of a confirmation,
        or a generation."""
        if state.race is not None:
            return self.requests.start(state, state.race)
        if state.confirmation is not None:
            return self.requests.confirmation(state, state.confirmation)
        return self.requests.generation(state)

    # -- tell ----------------------------------------------------------------------

    def tell(self, state: NESState, results: Sequence[EvaluationResult]) -> NESState:
        """The state after what `ask(state)` asked for; `results` may come in any order. After a
        generation, its record is the last of `records`. Raises InvalidInput unless there is one
        result for each request, with finite returns."""
        ordered = sorted(results, key=lambda result: result.index)
        if [result.index for result in ordered] != [*range(self.requests.number(state))]:
            raise InvalidInput(
                f"NES asked for {self.requests.number(state)} evaluations and needs one result of "
                f"each; got those of the requests {[result.index for result in ordered]}"
            )
        for result in ordered:
            if not (result.test_returns and np.isfinite(result.test_returns).all()):
                raise InvalidInput(
                    f"the result of request {result.index} has the test returns "
                    f"{result.test_returns}: they must be finite numbers, one or more"
                )
        real_steps = state.real_env_steps + sum(result.real_env_steps for result in ordered)
        cost = state.cost + sum(result.cost for result in ordered)
        state = replace(state, real_env_steps=real_steps, cost=cost)
        if state.race is not None:
            return self._at_winner(replace(state, race=state.race.after(ordered)))
        if state.confirmation is not None:
            scores = scores_of(ordered).tolist()
            return self._judged(state, state.confirmation.after(scores))
        return self._evolved(state, ordered)

    def _evolved(self, state: NESState, ordered: Sequence[EvaluationResult]) -> NESState:
        """The state after a generation."""
        nes, se, control = self.hp.nes, state.se, StepControl(self.hp.nes, state.refuted)
        z = np.stack([se.noise(seed) for seed in self.requests.perturbations(state)])
        scores = self._member_scores(ordered)
        step = control.refined(self.rule.step(nes, se.std_dev, z, scores))
        record = state.record_of(ordered, nes.centre_agents, step)
        state = replace(
            state,
            se=se.moved(step, control.averaging),
            generation=state.generation + 1,
            finalists=admitted(state.finalists, Finalist.of(se.average, record)),
            records=(*state.records, record),
        )
        if nes.confirming_agents and state.solved_for_long(nes):
            confirmation = Confirmation(nes.confirming_agents, state.refuted)
            state = replace(state, confirmation=confirmation)
        return self._restarted(self._ended(state))

    def _judged(self, state: NESState, confirmation: Confirmation) -> NESState:
        """The state after a round of a confirmation."""
        verdict = confirmation.verdict(self.task.solved_reward)
        left = confirmation if verdict is None else None
        refuted = state.refuted + (verdict is False)
        state = replace(state, confirmation=left, confirmed=bool(verdict), refuted=refuted)
        if left is None:
            state = replace(state, judged=state.generation)
        return self._ended(state)

    def _ended(self, state: NESState) -> NESState:
        """The state, finished if it is confirmed, or solved where nothing confirms it, or if its
        generations are over and no confirmation is under way."""
        nes = self.hp.nes
        solved = not nes.confirming_agents and state.solved_for_long(nes)
        over = state.generation >= nes.generations and state.confirmation is None
        return replace(state, finished=state.confirmed or solved or over)

    def _member_scores(self, ordered: Sequence[EvaluationResult]) -> MemberScores:
        centre, members = np.split(scores_of(ordered), [self.hp.nes.centre_agents])
        plus, *minus = members.reshape(-1, self.hp.nes.population_size)
        return MemberScores(centre, plus, minus[0] if minus else None)

    def _restarted(self, state: NESState) -> NESState:
        """The state begun again, if this attempt neither solved the task nor found a new best
        SE for so many generations, and the run is not over."""
        limit = self.hp.nes.restart_after
        attempt = [r.score_mean for r in state.records[state.attempt_began :]]
        if not limit or state.finished or not attempt or max(attempt) >= self.task.solved_reward:
            return state
        if len(attempt) - 1 - int(np.argmax(attempt)) < limit:
            return state
        return self._started(state, state.attempt + 1)
