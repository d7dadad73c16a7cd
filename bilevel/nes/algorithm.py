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
the coordinates of psi (`bilevel.synthetic_env.coordinates`); in the paper they are psi itself. A
run that does not get going begins again from other random SEs.

Every random number is derived from (run seed, purpose, attempt, generation, member), so a request
is the same whoever asks for it, and nothing random needs to be stored.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bilevel.agents.variation import draw_agent
from bilevel.errors import InvalidInput
from bilevel.evaluation import Centre, EvaluationRequest, EvaluationResult, Perturbed
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters, NESHyperparameters
from bilevel.nes.confirmation import Confirmation
from bilevel.nes.records import Finalist
from bilevel.nes.rules import RULES, MemberScores, UpdateRule
from bilevel.nes.start import StartRace
from bilevel.nes.state import NESState
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import SEDistribution, coordinates
from bilevel.tasks import Task
from bilevel.version import __version__

#: Numbers of failed confirmations that refine the steps, and the average (`nes.refinement`).
FINEST_STEP, FINEST_AVERAGE = 5, 2


@dataclass(frozen=True)
class NES:
    """An NES run as ask and tell; it evaluates nothing itself.

        state = nes.init()
        while not state.finished:
            results = [evaluate(task, state.se, request) for request in nes.ask(state)]
            state = nes.tell(state, results)

    Raises InvalidInput for hyperparameters that do not fit together, or not the task.
    """

    task: Task
    hp: Hyperparameters
    seed: int = 0

    def __post_init__(self) -> None:
        if self.rule.needs_pairs and not self.hp.nes.mirrored_sampling:
            raise InvalidInput(
                f"NES update {self.hp.nes.update!r} needs mirrored_sampling true; got false"
            )
        coordinates(self.task, self.hp.se, self.task.unit_scale)

    @property
    def rule(self) -> UpdateRule:
        """The update rule."""
        return RULES[self.hp.nes.update]

    @property
    def provenance(self) -> dict[str, Any]:
        """What the files of the run's SEs tell of it."""
        hp = self.hp.to_dict()
        return {"hyperparameters": hp, "seed": self.seed, "bilevel_version": __version__}

    # -- init ----------------------------------------------------------------------

    def init(self) -> NESState:
        """The state before anything is evaluated.

        It may make a few real steps for the scale of observations (`Task.observation_scale`); a
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
        """A state of this run that `NESState.save` wrote; a run that was out of generations goes
        on if there are more now. Raises InvalidInput."""
        return self._ended(NESState.load(path, self.task, self.hp.se, self.provenance))

    def _started(self, state: NESState, attempt: int) -> NESState:
        """The state with the candidates of an attempt, or, of one alone, at that."""
        candidates = self.hp.nes.start_candidates
        seeds = [derive(self.seed, Purpose.INITIAL, attempt, i) for i in range(candidates)]
        race = StartRace.of(seeds)
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
        or a generation: agents on the unperturbed SE, n_p on theta + eps_i, and with mirrored
        sampling n_p on theta - eps_i."""
        if state.race is not None:
            return self._ask_race(state, state.race)
        if state.confirmation is not None:
            return self._ask_confirmation(state, state.confirmation)
        nes, when = self.hp.nes, (state.attempt, state.generation)
        vary = self._variation(state)
        requests = [
            self._request(i, Purpose.CENTRE, (*when, i), i, Centre(), vary)
            for i in range(nes.centre_agents)
        ]
        for sign in (1, -1) if nes.mirrored_sampling else (1,):
            for member, seed in enumerate(self._perturbations(state)):
                on = Perturbed(seed, sign)
                own = () if nes.shared_agent else (member, int(sign > 0))
                requests.append(
                    self._request(
                        len(requests), Purpose.MEMBER, (*when, *own), state.generation, on, vary
                    )
                )
        return requests

    def _perturbations(self, state: NESState) -> list[int]:
        """Seeds of this generation's z, one a member."""
        path = (Purpose.PERTURBATION, state.attempt, state.generation)
        return [derive(self.seed, *path, i) for i in range(self.hp.nes.population_size)]

    def _ask_race(self, state: NESState, race: StartRace) -> list[EvaluationRequest]:
        paths = [(state.attempt, race.round, i) for i in range(race.agents)]
        return race.requests(
            [
                (
                    derive(self.seed, Purpose.START, *path),
                    as_turn(
                        self._agent(Purpose.START, path, self.hp.vary_agent), self.hp.nes, path[-1]
                    ),
                )
                for path in paths
            ]
        )

    def _ask_confirmation(
        self, state: NESState, confirmation: Confirmation
    ) -> list[EvaluationRequest]:
        paths = [(state.generation, number) for number in confirmation.coming]
        vary = "no" if self.hp.vary_agent == "no" else "narrowed"
        return [
            EvaluationRequest(
                index,
                derive(self.seed, Purpose.CONFIRM, *path),
                self._agent(Purpose.CONFIRM, path, vary),
            )
            for index, path in enumerate(paths)
        ]

    def _variation(self, state: NESState) -> str:
        """How a generation draws its agents. Small ones are the quickest to learn an SE for; once a
        confirmation has failed, they have little left to tell, and narrowed ones go on."""
        vary = self.hp.vary_agent
        return "narrowed" if vary == "small" and state.refuted else vary

    def _request(
        self,
        index: int,
        purpose: Purpose,
        path: tuple[int, ...],
        turn: int,
        on: Centre | Perturbed,
        vary: str,
    ) -> EvaluationRequest:
        agent = as_turn(self._agent(purpose, path, vary), self.hp.nes, turn)
        return EvaluationRequest(index, derive(self.seed, purpose, *path), agent, on)

    def _agent(self, purpose: Purpose, path: tuple[int, ...], vary: str) -> AgentHyperparameters:
        seed = derive(self.seed, Purpose.AGENT, int(purpose), *path)
        return draw_agent(self.hp.agents, vary, seed)

    # -- tell ----------------------------------------------------------------------

    def tell(self, state: NESState, results: Sequence[EvaluationResult]) -> NESState:
        """The state after what `ask(state)` asked for; `results` may come in any order. After a
        generation, its record is the last of `records`."""
        ordered = sorted(results, key=lambda result: result.index)
        real_steps = state.real_env_steps + sum(result.real_env_steps for result in ordered)
        state = replace(state, real_env_steps=real_steps)
        if state.race is not None:
            return self._at_winner(replace(state, race=state.race.after(ordered)))
        if state.confirmation is not None:
            scores_of_fresh = [result.score for result in ordered]
            return self._judged(state, state.confirmation.after(scores_of_fresh))
        nes, se = self.hp.nes, state.se
        scores = self._member_scores(ordered)
        z = np.stack([se.noise(seed) for seed in self._perturbations(state)])
        finer, slower = (
            nes.refinement ** min(state.refuted, most) for most in (FINEST_STEP, FINEST_AVERAGE)
        )
        step = np.float32(finer) * self.rule.step(nes, se.std_dev, z, scores)
        record = state.record_of(ordered, nes.centre_agents, step)
        generation = state.generation + 1
        state = replace(
            state,
            se=se.moved(step, 1 - slower * (1 - nes.averaging)),
            generation=generation,
            finalists=state.with_finalist(Finalist.of(se.average, record)),
            records=(*state.records, record),
        )
        if state.solved_for_long(nes):
            agents, confirmation = nes.confirming_agents, None
            if agents:
                confirmation = Confirmation(agents, state.refuted)
            state = replace(state, confirmation=confirmation, confirmed=not agents)
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
        """The state, finished if it is confirmed, or if its generations are over and no
        confirmation is under way."""
        over = state.generation >= self.hp.nes.generations and state.confirmation is None
        return replace(state, finished=state.confirmed or over)

    def _member_scores(self, ordered: Sequence[EvaluationResult]) -> MemberScores:
        scores = np.array([result.score for result in ordered])
        centre, members = np.split(scores, [self.hp.nes.centre_agents])
        plus, *minus = members.reshape(-1, self.hp.nes.population_size)
        return MemberScores(centre, plus, minus[0] if minus else None)

    def _restarted(self, state: NESState) -> NESState:
        """The state begun again, if this attempt neither solved the task nor found a new best
        SE for so many generations."""
        limit = self.hp.nes.restart_after
        attempt = [r.score_mean for r in state.records[state.attempt_began :]]
        if not limit or max(attempt) >= self.task.solved_reward:
            return state
        if len(attempt) - 1 - int(np.argmax(attempt)) < limit:
            return state
        return self._started(state, state.attempt + 1)


def as_turn(
    agent: AgentHyperparameters, nes: NESHyperparameters, turn: int
) -> AgentHyperparameters:
    """The agent as it trains in a turn of that number: in odd ones patiently, whatever its
    returns, if `nes` has patient agents."""
    if not nes.patient_episodes or turn % 2 == 0:
        return agent
    return replace(agent, max_episodes=nes.patient_episodes, early_out_difference=0.0)
