"""The hyperparameters of NES and SE, with their ranges and sources, and a whole run's.

Ranges here bound what is *valid*; the (narrower) ranges that are searched stand
in `search_spaces`. "Table 1" is the paper's table of optimized hyperparameters,
"fixed" the one of fixed, "default" the one of default hyperparameters.
"""

from dataclasses import asdict, dataclass
from typing import Any, Self

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters.agents import (
    ACTIVATIONS,
    AgentHyperparameters,
    agent_hyperparameters,
)
from bilevel.hyperparameters.validation import Validated, choice, ranged

#: The update rules and score transforms by name; `bilevel.nes` implements them.
UPDATES = ("snes", "antithetic", "paper", "authors")
SCORE_TRANSFORMS = (
    "linear",
    "rank",
    "nes",
    "nes-unnormalized",
    "single-best",
    "single-better-average",
    "better-average",
    "better-average-sum",
)

#: The rank of equal scores in a transform: their mean rank, or the order of the members (as the
#: authors' code has it).
TIES = ("mean", "order")

#: Whether learning rate, batch size and network of the agents are drawn anew: from all of the
#: paper's ranges, or only small networks and batches.
VARIATIONS = ("no", "small", "all")

#: What NES starts from: random SEs, as the paper, or one that is distilled from action values
#: learned on the real task (the supervised baseline).
STARTS = ("random", "distilled")

#: How NES parametrises an SE (`bilevel.synthetic_env.coordinates`).
STRUCTURES = ("plain", "exogenous")


@dataclass(frozen=True, kw_only=True)
class NESHyperparameters(Validated):
    """Natural evolution strategies (paper, Algorithm 1)."""

    update: str = choice(UPDATES)
    step_size: float = ranged(1e-6, 100.0)  # alpha
    std_dev: float = ranged(1e-6, 10.0)  # sigma of the perturbations
    mirrored_sampling: bool  # evaluate psi - eps beside psi + eps
    score_transform: str = choice(SCORE_TRANSFORMS)  # read by `paper` and `authors`
    ties: str = choice(TIES)  # read by `paper` and `authors`
    population_size: int = ranged(1, 65536)  # n_p, members a generation
    generations: int = ranged(1, 1_000_000)  # n_o, outer loops at most
    # One agent and one set of random numbers for all members of a generation, new ones in the
    # next (common random numbers); false: every member has its own.
    shared_agent: bool
    centre_agents: int = ranged(1, 65536)  # trained on the unperturbed SE, each generation
    # Every second generation its agents train until max_episodes (an even number of agents on
    # the unperturbed SE likewise), whatever their returns. 0: the stopping rule decides always.
    patient_episodes: int = ranged(0, 1_000_000)
    # Share of the moving average of psi that is kept in a generation; the average is the
    # unperturbed SE. 0: psi itself is, as in the paper.
    averaging: float = ranged(0.0, 0.999)
    start: str = choice(STARTS)
    start_candidates: int = ranged(1, 65536)  # random SEs of which the start is chosen
    # Generations without a new highest score after which a run that has not solved the task
    # begins again from other random SEs. 0: it never does.
    restart_after: int = ranged(0, 1_000_000)
    # Generations in a row that must solve the task for the run to be finished. 0: it goes on.
    solved_for: int = ranged(0, 1_000_000)
    # Fresh agents that must surely solve the task then; if they do not, the run goes on.
    confirming_agents: int = ranged(0, 65536)

    @property
    def evaluations(self) -> int:
        """Evaluations of one generation: centre, +eps, and -eps if mirrored."""
        return self.centre_agents + self.population_size * (2 if self.mirrored_sampling else 1)


@dataclass(frozen=True, kw_only=True)
class SEHyperparameters(Validated):
    """The three networks of a synthetic environment, and its step limit."""

    structure: str = choice(STRUCTURES)
    hidden_layers: int = ranged(1, 2)
    hidden_size: int = ranged(1, 4096)
    activation: str = choice(ACTIVATIONS)
    # Steps after which an episode on the SE is truncated. 0: the task's own limit.
    step_limit: int = ranged(0, 1_000_000)


@dataclass(frozen=True, kw_only=True)
class Hyperparameters:
    """Everything one NES run is given besides task and seed.

    Of several `agents`, every evaluation draws one.
    """

    nes: NESHyperparameters
    se: SEHyperparameters
    agents: tuple[AgentHyperparameters, ...]
    vary_agent: str  # of VARIATIONS
    recipe: str  # the name of the recipe that they were read from, whatever was replaced since

    def __post_init__(self) -> None:
        if self.vary_agent not in VARIATIONS:
            raise one_of("variation of agents", self.vary_agent, VARIATIONS)
        names = [hp.agent for hp in self.agents]
        if not names or len(set(names)) < len(names):
            raise InvalidInput(f"agents must be one or more, each once; got {names}")
        if self.nes.start == "distilled" and self.se.structure != "plain":
            raise InvalidInput(
                "NES start 'distilled' needs the SE structure 'plain' (as in --recipe distilled); "
                f"got {self.se.structure!r}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Nested dictionary of plain values, for JSON."""
        return {
            "nes": asdict(self.nes),
            "se": asdict(self.se),
            "agents": {hp.agent: asdict(hp) for hp in self.agents},
            "vary_agent": self.vary_agent,
            "recipe": self.recipe,
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The inverse of `to_dict`. Raises InvalidInput."""
        try:
            return cls(
                nes=NESHyperparameters.from_dict(values["nes"]),
                se=SEHyperparameters.from_dict(values["se"]),
                agents=tuple(
                    agent_hyperparameters(name).from_dict(fields)
                    for name, fields in values["agents"].items()
                ),
                vary_agent=values["vary_agent"],
                recipe=str(values["recipe"]),
            )
        except (KeyError, TypeError, AttributeError) as error:
            raise InvalidInput(f"hyperparameters lack the section {error}") from None
