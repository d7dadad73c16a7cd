"""Hyperparameters of NES, of SEs and of whole runs, with their valid ranges (`search_spaces` has
narrower ranges)."""

from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from bilevel.errors import InvalidInput
from bilevel.hyperparameters.agents import Activation, AgentHyperparameters, agent_hyperparameters
from bilevel.hyperparameters.validation import hyperparameters

#: Update rules and score transforms by name (`bilevel.evolution`).
Update = Literal["nes", "antithetic", "paper", "authors"]
UPDATES: tuple[str, ...] = get_args(Update)
ScoreTransform = Literal[
    "linear",
    "rank",
    "nes",
    "nes-unnormalized",
    "single-best",
    "single-better-average",
    "better-average",
    "better-average-sum",
]
SCORE_TRANSFORMS: tuple[str, ...] = get_args(ScoreTransform)

#: How learning rate, batch size and network of agents are drawn (`bilevel.agents.variation`).
Variation = Literal["no", "small", "narrowed", "all"]
VARIATIONS: tuple[str, ...] = get_args(Variation)

#: Confirming agents for recipes that specify none because their runs never stop early.
CONFIRMING_AGENTS = 128

_Count = Annotated[int, Field(ge=1, le=65536)]


@hyperparameters
class NESHyperparameters:
    """Natural evolution strategies (paper, Algorithm 1)."""

    update: Update  #: The update rule.
    step_size: Annotated[float, Field(ge=1e-6, le=100.0)]  #: alpha.
    std_dev: Annotated[float, Field(ge=1e-6, le=10.0)]  #: sigma of the perturbations.
    mirrored_sampling: bool  #: Evaluate mean - eps in addition to mean + eps.
    #: Transform of the members' scores in the rules `paper` and `authors`.
    score_transform: ScoreTransform
    #: Rank of equal scores in the transform: their mean rank, or the order of the members as in the
    #: authors' code.
    ties: Literal["mean", "order"]
    population_size: _Count  #: n_p, members per generation (without mirror images).
    generations: Annotated[int, Field(ge=1, le=1_000_000)]  #: n_o, the maximum.
    #: Whether all members of a generation share one agent and its random numbers (common random
    #: numbers).
    shared_agent: bool
    centre_agents: _Count  #: Agents trained on the unperturbed SE per generation.
    #: Test episodes of each agent during the run; scores differ more between agents than between
    #: episodes. 0 selects the agent's `test_episodes`, which the tests after the run always use.
    test_episodes: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Training episodes of patient agents, which ignore the stopping rule: members' agents in every
    #: second generation, and every second agent on the unperturbed SE, in the choice of a start and
    #: in retests. Confirmations and final tests have none. 0 disables patient agents.
    patient_episodes: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Share of the moving average of means that a generation keeps. The unperturbed SE is at the
    #: average. 0 disables averaging, as in the paper.
    averaging: Annotated[float, Field(ge=0.0, le=0.999)]
    #: Factor of the step size and of the rate of the average per failed confirmation.
    refinement: Annotated[float, Field(gt=0.0, le=1.0)]
    start_candidates: _Count  #: Random SEs of which the best one is the start.
    #: Generations without a new highest score after which an unsolved run restarts from other
    #: random SEs. 0 disables restarts.
    restart_after: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Generations whose mean score must solve the task to end the run. 0 disables early stopping.
    solved_for: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Fresh agents that must confirm the SE before the run ends (`bilevel.nes.confirmation`).
    #: 0 disables confirmation.
    confirming_agents: Annotated[int, Field(ge=0, le=65536)]

    @property
    def evaluations(self) -> int:
        """Evaluations per generation: centre, +eps, and -eps if mirrored."""
        return self.centre_agents + self.population_size * (2 if self.mirrored_sampling else 1)


@hyperparameters
class SEHyperparameters:
    """The three networks of a synthetic environment, and its step limit."""

    #: What NES searches, and how a random SE is drawn (`bilevel.synthetic_env.families`).
    family: Literal["plain", "exogenous", "one-step"]
    hidden_layers: Annotated[int, Field(ge=1, le=2)]  #: Hidden layers of each network.
    hidden_size: Annotated[int, Field(ge=1, le=4096)]  #: Units per hidden layer.
    activation: Activation  #: Activation of the hidden layers.
    #: Steps after which an episode on the SE is truncated. 0 selects the task's limit.
    step_limit: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Factor by which a step moves states away from the mean observation (`exogenous` only).
    #: Episodes are longer near 1; below 1, states stay where episodes start.
    spread: Annotated[float, Field(ge=0.5, le=2.0)]


@hyperparameters
class Hyperparameters:
    """All hyperparameters of an NES run. Each evaluation draws one of the `agents`, or each
    generation with `nes.shared_agent`."""

    nes: NESHyperparameters
    se: SEHyperparameters
    agents: tuple[AgentHyperparameters, ...]
    vary_agent: Variation
    recipe: str  # name of the recipe, even if values were replaced

    def __post_init__(self) -> None:
        names = [hp.agent for hp in self.agents]
        if not names or len(set(names)) < len(names):
            raise InvalidInput(f"agents must be one or more different agents; got {names}")
        for agent in self.agents:
            agent.require_learning(self.nes.patient_episodes)

    @property
    def sections(self) -> dict[str, Any]:
        """NES, SE and agents by their section names in recipes and search spaces."""
        return {"nes": self.nes, "se": self.se, **{hp.agent: hp for hp in self.agents}}

    def to_dict(self) -> dict[str, Any]:
        """Return a nested dictionary of plain values, for JSON."""
        return {**asdict(self), "agents": {hp.agent: asdict(hp) for hp in self.agents}}


@dataclass(frozen=True, kw_only=True)
class StoredHyperparameters:
    """The result of `Hyperparameters.to_dict`, unchecked: this process may not know an agent."""

    nes: dict[str, Any]
    se: dict[str, Any]
    agents: dict[str, dict[str, Any]]
    vary_agent: Variation
    recipe: str

    def checked(self) -> Hyperparameters:
        """Validate all sections. Raises InvalidInput."""
        return Hyperparameters(
            nes=NESHyperparameters(**self.nes),
            se=SEHyperparameters(**self.se),
            agents=tuple(agent_hyperparameters(n)(**fields) for n, fields in self.agents.items()),
            vary_agent=self.vary_agent,
            recipe=self.recipe,
        )
