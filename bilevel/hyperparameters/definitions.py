"""The hyperparameters of NES and SE, and those of a whole run.

Ranges bound what is valid; the narrower ranges that are searched are in `search_spaces`.
"""

from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from bilevel.errors import InvalidInput
from bilevel.hyperparameters.agents import Activation, AgentHyperparameters, agent_hyperparameters
from bilevel.hyperparameters.validation import hyperparameters

#: The update rules and score transforms by name; `bilevel.nes` implements them.
Update = Literal["snes", "antithetic", "paper", "authors"]
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

#: The rank of equal scores in a transform: their mean rank, or the order of the members (as the
#: authors' code has it).
Ties = Literal["mean", "order"]

#: Whether learning rate, batch size and network of the agents are drawn anew: only small networks
#: and batches, or from all of the paper's ranges, with large networks narrowed or not.
Variation = Literal["no", "small", "narrowed", "all"]
VARIATIONS: tuple[str, ...] = get_args(Variation)

#: What NES starts from: random SEs, as the paper, or one that is distilled from action values
#: learned on the real task (the supervised baseline).
Start = Literal["random", "distilled"]

#: How NES parametrises an SE (`bilevel.synthetic_env.coordinates`).
Structure = Literal["plain", "exogenous"]

#: Agents of a confirmation where a recipe, whose runs never stop early, has none.
CONFIRMING_AGENTS = 128

_Count = Annotated[int, Field(ge=1, le=65536)]


@hyperparameters
class NESHyperparameters:
    """Natural evolution strategies (paper, Algorithm 1)."""

    update: Update  #: The update rule.
    step_size: Annotated[float, Field(ge=1e-6, le=100.0)]  #: Alpha, the step.
    std_dev: Annotated[float, Field(ge=1e-6, le=10.0)]  #: Sigma of the perturbations.
    mirrored_sampling: bool  #: Whether mean - eps is evaluated beside mean + eps.
    #: What becomes of the members' scores in the rules `paper` and `authors`.
    score_transform: ScoreTransform
    #: The rank of equal scores in these: their mean rank, or the order of the members.
    ties: Ties
    population_size: _Count  #: n_p, the members of a generation (without mirror images).
    generations: Annotated[int, Field(ge=1, le=1_000_000)]  #: n_o, the outer loops at most.
    #: One agent and one set of random numbers for all members of a generation, new ones in the
    #: next (common random numbers). False: every member has its own.
    shared_agent: bool
    centre_agents: _Count  #: Agents trained on the unperturbed SE, each generation.
    #: Episodes for which the members' agents train in every second generation, whatever their
    #: returns, and so does every second agent on the unperturbed SE and in the choice of a start.
    #: 0: the stopping rule decides always.
    patient_episodes: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Share of the moving average of the distribution's mean that is kept in a generation; the
    #: average is the unperturbed SE. 0: the mean itself is, as in the paper.
    averaging: Annotated[float, Field(ge=0.0, le=0.999)]
    #: Factor by which each failed confirmation multiplies the step and the rate of the average.
    refinement: Annotated[float, Field(gt=0.0, le=1.0)]
    start: Start  #: What NES starts from: random SEs, or a distilled one (the baseline).
    start_candidates: _Count  #: Random SEs among which the start is chosen.
    #: Generations without a new highest score after which a run that has not solved the task
    #: begins again from other random SEs. 0: it never does.
    restart_after: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Generations that must solve the task on average for the run to be finished. 0: it goes on,
    #: and nobody confirms anything.
    solved_for: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Fresh agents that must then confirm it (`bilevel.nes.confirmation`); otherwise the run goes
    #: on. 0: nobody confirms it, and the run is finished.
    confirming_agents: Annotated[int, Field(ge=0, le=65536)]

    @property
    def evaluations(self) -> int:
        """Evaluations of one generation: centre, +eps, and -eps if mirrored."""
        return self.centre_agents + self.population_size * (2 if self.mirrored_sampling else 1)


@hyperparameters
class SEHyperparameters:
    """The three networks of a synthetic environment, and its step limit."""

    structure: Structure  #: How NES parametrises the networks.
    hidden_layers: Annotated[int, Field(ge=1, le=2)]  #: Of each network.
    hidden_size: Annotated[int, Field(ge=1, le=4096)]  #: Units a hidden layer.
    activation: Activation  #: Of the hidden layers.
    #: Steps after which an episode on the SE is truncated. 0: the task's own limit.
    step_limit: Annotated[int, Field(ge=0, le=1_000_000)]
    #: Factor by which one step carries states away from the mean observation, read by `exogenous`.
    #: The nearer to 1, the longer the episodes; below it, states stay where episodes begin.
    spread: Annotated[float, Field(ge=0.5, le=2.0)]


@hyperparameters
class Hyperparameters:
    """Everything one NES run is given besides task and seed.

    Of several `agents`, each draw takes one: every evaluation draws, or, with
    `nes.shared_agent`, every generation for all of its members.
    """

    nes: NESHyperparameters
    se: SEHyperparameters
    agents: tuple[AgentHyperparameters, ...]
    vary_agent: Variation = Field(title="variation of agents")
    recipe: str  # the name of the recipe that they were read from, whatever was replaced since

    def __post_init__(self) -> None:
        names = [hp.agent for hp in self.agents]
        if not names or len(set(names)) < len(names):
            raise InvalidInput(f"agents must be one or more, each once; got {names}")
        for agent in self.agents:
            agent.require_learning(self.nes.patient_episodes)
        if self.nes.start == "distilled" and self.se.structure != "plain":
            raise InvalidInput(
                "nes.start 'distilled' needs se.structure 'plain' (as in --recipe distilled); "
                f"got {self.se.structure!r}"
            )
        if self.nes.start == "distilled" and self.nes.restart_after:
            raise InvalidInput(
                "nes.restart_after must be 0 with the start 'distilled', which a restart would "
                f"replace by a random one; got {self.nes.restart_after}"
            )
        if self.nes.start == "distilled" and self.nes.start_candidates > 1:
            raise InvalidInput(
                "nes.start_candidates must be 1 with the start 'distilled', which is the only one; "
                f"got {self.nes.start_candidates}"
            )

    @property
    def sections(self) -> dict[str, Any]:
        """NES, SE and agents by the names that recipes and searches give them."""
        return {"nes": self.nes, "se": self.se, **{hp.agent: hp for hp in self.agents}}

    def to_dict(self) -> dict[str, Any]:
        """Nested dictionary of plain values, for JSON."""
        return {
            "nes": asdict(self.nes),
            "se": asdict(self.se),
            "agents": {hp.agent: asdict(hp) for hp in self.agents},
            "vary_agent": self.vary_agent,
            "recipe": self.recipe,
        }


@dataclass(frozen=True, kw_only=True)
class StoredHyperparameters:
    """What `Hyperparameters.to_dict` makes, its sections not yet checked: agents of a user's own
    may be unknown."""

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
