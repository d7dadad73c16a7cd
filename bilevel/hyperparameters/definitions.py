"""The hyperparameters of NES and SE, with their ranges and sources, and a whole run's.

Ranges here bound what is *valid*; the (narrower) ranges that are searched stand
in `search_spaces`. "Table 1" is the paper's table of optimized hyperparameters,
"fixed" the one of fixed, "default" the one of default hyperparameters.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Self

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters.agents import (
    ACTIVATIONS,
    AgentHyperparameters,
    agent_hyperparameters,
)
from bilevel.hyperparameters.validation import Validated, choice, ranged

#: Evaluations of a random candidate for the start that is retested, and of a fitted one.
RETESTS, FIT_TESTS = 8, 32

#: The update rules and score transforms by name; `bilevel.nes` implements them.
UPDATES = ("paired", "antithetic", "paper", "authors")
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

#: Whether learning rate, batch size and network of the agents are drawn anew for every
#: member: from all of the paper's ranges, or only small networks and batches.
VARIATIONS = ("no", "small", "all")

#: What NES starts from: random initialisations, as the paper, or SEs fitted to the task.
STARTS = ("random", "fitted")


class StartSizes(NamedTuple):
    """How many random candidates the search for a start screens, how many of them twice, and
    how many of these it retests."""

    screened: int
    rescreened: int
    retested: int

    @property
    def evaluations(self) -> int:
        """In all."""
        return self.screened + self.rescreened + self.retested * RETESTS


@dataclass(frozen=True, kw_only=True)
class NESHyperparameters(Validated):
    """Natural evolution strategies (paper, Algorithm 1)."""

    step_size: float = ranged(1e-6, 100.0)  # alpha
    std_dev: float = ranged(1e-6, 10.0)  # sigma of the perturbations
    mirrored_sampling: bool  # evaluate psi - eps beside psi + eps
    score_transform: str = choice(SCORE_TRANSFORMS)  # read by `paper`, `authors`
    update: str = choice(UPDATES, "paired")
    population_size: int = ranged(1, 65536, 16)  # n_p, members a generation
    generations: int = ranged(1, 1_000_000, 200)  # n_o, outer loops at most
    start: str = choice(STARTS, "random")
    start_candidates: int = ranged(1, 65536, 1)  # of which the start is chosen
    # Share of psi's score (above the task's worst) that its perturbations shall keep: sigma
    # and alpha are adapted to it every generation. 0: they stay.
    retention: float = ranged(0.0, 1.0, 0.0)
    momentum: float = ranged(0.0, 0.999, 0.0)  # share of the last step that is made again
    # Standard errors by which psi may score less than the best psi so far (or, if that solves
    # the task, than the solved reward) before NES goes back to that one. 0: it never does.
    fallback: float = ranged(0.0, 100.0, 0.0)
    # Of agents that the run trains: one that trains for longer is no result to wait for.
    max_episodes: int = ranged(1, 1_000_000, 1_000_000)
    # Share of the score (above the task's worst) that 1000 train steps cost in the fitness.
    # 0: the paper's fitness, which is the score.
    step_price: float = ranged(0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.update in ("paired", "antithetic") and not self.mirrored_sampling:
            raise InvalidInput(
                f"NES update {self.update!r} needs mirrored_sampling true; got false"
            )

    @property
    def start_sizes(self) -> StartSizes:
        """Of the search among random candidates."""
        n = self.start_candidates
        retested = math.ceil(n / 32)
        return StartSizes(n, min(4 * retested, n), retested)

    @property
    def start_evaluations(self) -> int:
        """Evaluations that choose the start; a single candidate is tried by nobody, of fitted
        ones, which are few and good, all are tried at once."""
        if self.start_candidates == 1:
            return 0
        if self.start == "fitted":
            return self.start_candidates * FIT_TESTS
        return self.start_sizes.evaluations

    @property
    def evaluations(self) -> int:
        """Evaluations of one generation: centre, +eps, and -eps if mirrored."""
        return self.population_size * (3 if self.mirrored_sampling else 2)


@dataclass(frozen=True, kw_only=True)
class SEHyperparameters(Validated):
    """The three networks of a synthetic environment, and its step limit."""

    hidden_layers: int = ranged(1, 2)
    hidden_size: int = ranged(1, 4096)
    activation: str = choice(ACTIVATIONS)
    # Factor of the reward network's last layer, in what it starts with and in perturbations.
    reward_scale: float = ranged(1e-6, 1e6, 1.0)
    # Share of the task's step limit after which an episode on the SE ends. 1: the paper's.
    step_limit_share: float = ranged(1e-6, 1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Hyperparameters:
    """Everything one NES run is given besides task and seed.

    Of several `agents`, every member of a generation draws one.
    """

    nes: NESHyperparameters
    se: SEHyperparameters
    agents: tuple[AgentHyperparameters, ...]
    vary_agent: str = "no"  # of VARIATIONS

    def __post_init__(self) -> None:
        if self.vary_agent not in VARIATIONS:
            raise one_of("variation of agents", self.vary_agent, VARIATIONS)
        names = [hp.agent for hp in self.agents]
        if not names or len(set(names)) < len(names):
            raise InvalidInput(f"agents must be one or more, each once; got {names}")

    def to_dict(self) -> dict[str, Any]:
        """Nested dictionary of plain values, for JSON."""
        return {
            "nes": asdict(self.nes),
            "se": asdict(self.se),
            "agents": {hp.agent: asdict(hp) for hp in self.agents},
            "vary_agent": self.vary_agent,
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
                vary_agent=values.get("vary_agent", "no"),
            )
        except (KeyError, TypeError, AttributeError) as error:
            raise InvalidInput(f"hyperparameters lack the section {error}") from None
