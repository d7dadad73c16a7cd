"""The evaluations of an NES run: which fresh agent trains on which SE, with which random numbers.

Every random number is derived from (run seed, purpose, attempt, generation, member), so a request
is the same whoever asks for it, and nothing random needs to be stored.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from bilevel.agents.variation import draw_agent
from bilevel.evaluation import Centre, EvaluationRequest, Perturbed
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters, NESHyperparameters
from bilevel.hyperparameters.validation import within_range
from bilevel.nes.confirmation import Confirmation
from bilevel.nes.start import StartRace
from bilevel.nes.state import NESState
from bilevel.seeds import Purpose, derive

#: Seed and hyperparameters of an agent.
Trial = tuple[int, AgentHyperparameters]


@dataclass(frozen=True)
class Requests:
    """The evaluations of the run with these hyperparameters and this seed."""

    hp: Hyperparameters
    seed: int

    def candidates(self, attempt: int) -> list[int]:
        """Initialisation seeds of the random SEs that an attempt chooses its start from."""
        number = self.hp.nes.start_candidates
        return [derive(self.seed, Purpose.INITIAL, attempt, i) for i in range(number)]

    def perturbations(self, state: NESState) -> list[int]:
        """Seeds of this generation's z, one for each of the n_p members."""
        path = (Purpose.PERTURBATION, state.attempt, state.generation)
        return [derive(self.seed, *path, i) for i in range(self.hp.nes.population_size)]

    def number(self, state: NESState) -> int:
        """Number of the evaluations that come next."""
        if state.race is not None:
            return len(state.race.seeds) * state.race.agents
        if state.confirmation is not None:
            return len(state.confirmation.coming)
        return self.hp.nes.evaluations

    def start(self, state: NESState, race: StartRace) -> list[EvaluationRequest]:
        """A round of the choice of a start: the same agents for every candidate."""
        vary = self.hp.vary_agent
        return race.requests(
            [
                self._trial(Purpose.START, (state.attempt, race.round, i), i, vary)
                for i in range(race.agents)
            ]
        )

    def generation(self, state: NESState) -> list[EvaluationRequest]:
        """A generation: agents on the unperturbed SE, n_p on theta + eps_i, and with mirrored
        sampling n_p on theta - eps_i."""
        nes, when, vary = self.hp.nes, (state.attempt, state.generation), self._variation(state)
        chosen: list[tuple[Trial, Centre | Perturbed]] = [
            (self._trial(Purpose.CENTRE, (*when, i), i, vary), Centre())
            for i in range(nes.centre_agents)
        ]
        for sign in (1, -1) if nes.mirrored_sampling else (1,):
            for member, seed in enumerate(self.perturbations(state)):
                own = () if nes.shared_agent else (member, int(sign > 0))
                trial = self._trial(Purpose.MEMBER, (*when, *own), state.generation, vary)
                chosen.append((trial, Perturbed(seed, sign)))
        return [EvaluationRequest(index, *trial, on) for index, (trial, on) in enumerate(chosen)]

    def confirmation(self, state: NESState, confirmation: Confirmation) -> list[EvaluationRequest]:
        """A round of a confirmation: agents of the paper's full ranges, narrowed, or the recipe's
        own ones if it varies none, which train by the stopping rule on the unperturbed SE."""
        vary = "no" if self.hp.vary_agent == "no" else "narrowed"
        numbers = enumerate(confirmation.coming)
        return [
            EvaluationRequest(
                index,
                *fresh_agent(
                    self.hp.agents, vary, self.seed, Purpose.CONFIRM, state.generation, number
                ),
            )
            for index, number in numbers
        ]

    def _variation(self, state: NESState) -> str:
        """The variation of a generation's agents. Small ones are the quickest to learn an SE for;
        once a confirmation has failed, they have little left to tell, and narrowed ones go on."""
        vary = self.hp.vary_agent
        return "narrowed" if vary == "small" and state.refuted else vary

    def _trial(self, purpose: Purpose, path: Sequence[int], turn: int, vary: str) -> Trial:
        seed, agent = fresh_agent(self.hp.agents, vary, self.seed, purpose, *path)
        return seed, as_turn(agent, self.hp.nes, turn)


def fresh_agent(
    agents: tuple[AgentHyperparameters, ...],
    vary: str,
    root: int,
    purpose: Purpose,
    *path: int,
) -> Trial:
    """Seed of an evaluation, and the agent that it trains, drawn from one of `agents`. Two seeds
    of their own, so that equal agents differ in their random numbers."""
    drawn_by = derive(root, Purpose.AGENT, int(purpose), *path)
    return derive(root, purpose, *path), draw_agent(agents, vary, drawn_by)


def as_turn(
    agent: AgentHyperparameters, nes: NESHyperparameters, turn: int
) -> AgentHyperparameters:
    """The agent as it trains in a turn of that number: in odd ones patiently, for a fixed number of
    episodes whatever its returns, if `nes` has patient agents."""
    if not nes.patient_episodes or turn % 2 == 0:
        return agent
    # The stopping rule compares two windows of `early_out_episodes`, for which none are left.
    episodes = min(nes.patient_episodes, agent.max_episodes)
    names = ("max_episodes", "early_out_episodes")
    return replace(agent, **{name: within_range(type(agent), name, episodes) for name in names})
