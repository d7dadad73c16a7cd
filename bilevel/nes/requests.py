"""The evaluations of an NES run: which agent trains on which SE, with which random numbers.

Every seed is derived from (run seed, purpose, attempt, generation, member). Requests are therefore
reproducible, and a checkpoint stores no random state.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

from bilevel.agents.variation import draw_agent
from bilevel.errors import InvalidInput
from bilevel.evaluation import (
    Centre,
    EvaluationRequest,
    EvaluationResult,
    Initialized,
    Perturbed,
)
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters, NESHyperparameters
from bilevel.hyperparameters.validation import within_range
from bilevel.nes.confirmation import CONFIRMING_EPISODES, Confirming
from bilevel.nes.start import ChoosingStart
from bilevel.nes.state import NESState
from bilevel.seeds import Purpose, derive

#: Training episodes in the choice of a start: the largest of this number, a multiple of the agent's
#: `init_episodes`, in which it does not learn, and a share of its `max_episodes`.
BRIEF_EPISODES, BRIEF_INIT, BRIEF_SHARE = 40, 4, 0.25

#: Seed and hyperparameters of an agent.
Trial = tuple[int, AgentHyperparameters]


@dataclass(frozen=True)
class Requests:
    """The evaluations of a run with these hyperparameters and this seed."""

    hp: Hyperparameters
    seed: int

    def candidates(self, attempt: int, draw: int = 0) -> list[int]:
        """Return the initialisation seeds of the random SEs from which an attempt chooses."""
        number = self.hp.nes.start_candidates
        numbers = range(draw * number, (draw + 1) * number)
        return [derive(self.seed, Purpose.INITIAL, attempt, i) for i in numbers]

    def perturbations(self, state: NESState) -> list[int]:
        """Return the noise seeds of this generation's n_p members."""
        path = (Purpose.PERTURBATION, state.attempt, state.generation)
        return [derive(self.seed, *path, i) for i in range(self.hp.nes.population_size)]

    def start(self, choosing: ChoosingStart, attempt: int) -> list[EvaluationRequest]:
        """Return a round of the choice of a start: the same agents for every candidate."""
        halving, vary, trials = choosing.halving, self.hp.vary_agent, list[Trial]()
        for i in range(halving.agents):
            path = attempt, choosing.draws, halving.round, i
            seed, agent = self._trial(Purpose.START, path, i, vary)
            # Most candidates are far from the best: one episode shows that.
            episodes = agent.test_episodes if halving.round else 1
            trials.append((seed, replace(brief(agent), test_episodes=episodes)))
        pairs = enumerate(product(halving.left, trials))
        return [EvaluationRequest(i, *trial, Initialized(seed)) for i, (seed, trial) in pairs]

    def generation(self, state: NESState) -> list[EvaluationRequest]:
        """Return a generation: agents on the unperturbed SE, n_p on mean + eps_i, and, with
        mirrored sampling, n_p on mean - eps_i."""
        nes, when, vary = self.hp.nes, (state.attempt, state.generation), self.hp.vary_agent
        if vary == "small" and state.refuted:
            vary = "narrowed"  # small agents no longer distinguish SEs
        chosen: list[tuple[Trial, Centre | Perturbed]] = [
            (self._trial(Purpose.CENTRE, (*when, i), i, vary), Centre())
            for i in range(nes.centre_agents)
        ]
        for sign in (1, -1) if nes.mirrored_sampling else (1,):
            for member, seed in enumerate(self.perturbations(state)):
                path = when if nes.shared_agent else (*when, member, int(sign > 0))
                trial = self._trial(Purpose.MEMBER, path, state.generation, vary)
                chosen.append((trial, Perturbed(seed, sign)))
        return [EvaluationRequest(index, *trial, on) for index, (trial, on) in enumerate(chosen)]

    def confirmation(self, confirming: Confirming, generation: int) -> list[EvaluationRequest]:
        """Return a round of a confirmation: agents that train on the unperturbed SE."""
        vary = "no" if self.hp.vary_agent == "no" else "narrowed"
        requests = []
        for index, number in enumerate(confirming.coming):
            seed, agent = self._fresh(Purpose.CONFIRM, (generation, number), vary)
            episodes = max(agent.test_episodes, CONFIRMING_EPISODES)
            requests.append(EvaluationRequest(index, seed, replace(agent, test_episodes=episodes)))
        return requests

    def _trial(self, purpose: Purpose, path: Sequence[int], turn: int, vary: str) -> Trial:
        seed, agent = self._fresh(purpose, path, vary)
        return seed, with_patience(agent, self.hp.nes, turn)

    def _fresh(self, purpose: Purpose, path: Sequence[int], vary: str) -> Trial:
        seed, agent = fresh_agent(self.hp.agents, vary, self.seed, purpose, *path)
        episodes = self.hp.nes.test_episodes or agent.test_episodes
        return seed, replace(agent, test_episodes=episodes)


def fresh_agent(
    agents: tuple[AgentHyperparameters, ...], vary: str, root: int, purpose: Purpose, *path: int
) -> Trial:
    """Return the seed of an evaluation, and its agent, drawn from `agents` by another seed."""
    agent_seed = derive(root, Purpose.AGENT, int(purpose), *path)
    return derive(root, purpose, *path), draw_agent(agents, vary, agent_seed)


def brief(agent: AgentHyperparameters) -> AgentHyperparameters:
    """Shorten the training of an agent in the choice of a start."""
    share = round(BRIEF_SHARE * agent.max_episodes)
    episodes = max(BRIEF_EPISODES, BRIEF_INIT * agent.init_episodes, share)
    episodes = within_range(type(agent), "max_episodes", episodes)
    return replace(agent, max_episodes=min(agent.max_episodes, episodes))


def with_patience(
    agent: AgentHyperparameters, nes: NESHyperparameters, turn: int
) -> AgentHyperparameters:
    """Make the agents of odd turns patient: they train `nes.patient_episodes` episodes."""
    if not nes.patient_episodes or turn % 2 == 0:
        return agent
    # The stopping rule compares two windows of `early_out_episodes`, which never become complete.
    episodes = min(nes.patient_episodes, agent.max_episodes)
    names = ("max_episodes", "early_out_episodes")
    return replace(agent, **{name: within_range(type(agent), name, episodes) for name in names})


def ordered_results(results: Sequence[EvaluationResult], expected: int) -> list[EvaluationResult]:
    """Sort results by index. Raises InvalidInput for missing or repeated results."""
    ordered = sorted(results, key=lambda result: result.index)
    numbers = [result.index for result in ordered]
    if numbers != [*range(expected)]:
        raise InvalidInput(f"NES asked for {expected} evaluations; got results for {numbers}")
    return ordered
