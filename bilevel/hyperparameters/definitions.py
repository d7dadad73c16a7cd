"""The hyperparameters of NES, SE and agents, with their ranges and sources.

Ranges here bound what is *valid*; the (narrower) ranges that are searched stand
in `search_spaces`. "Table 1" is the paper's table of optimized hyperparameters,
"fixed" the one of fixed, "default" the one of default hyperparameters.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any, Self

from bilevel.errors import InvalidInput
from bilevel.hyperparameters.validation import Validated, choice, ranged
from bilevel.kernels.activations import CODES

ACTIVATIONS = tuple(CODES)

#: Of the start candidates one in so many is evaluated again, so many times.
RETEST_ONE_IN, RETESTS = 8, 8

#: The update rules and score transforms by name; `bilevel.nes` implements them.
UPDATES = ("antithetic", "paper", "authors")
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


@dataclass(frozen=True, kw_only=True)
class NESHyperparameters(Validated):
    """Natural evolution strategies (paper, Algorithm 1)."""

    step_size: float = ranged(1e-6, 100.0)  # alpha
    std_dev: float = ranged(1e-6, 10.0)  # sigma of the perturbations
    mirrored_sampling: bool  # evaluate psi - eps beside psi + eps
    score_transform: str = choice(SCORE_TRANSFORMS)  # read by `paper`, `authors`
    update: str = choice(UPDATES, "antithetic")
    population_size: int = ranged(1, 65536, 16)  # n_p, members a generation
    generations: int = ranged(1, 1_000_000, 200)  # n_o, outer loops at most
    start_candidates: int = ranged(1, 65536, 1)  # initialisations the start is chosen from

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.update == "antithetic" and not self.mirrored_sampling:
            raise InvalidInput("NES update 'antithetic' needs mirrored_sampling true; got false")

    @property
    def start_evaluations(self) -> int:
        """Evaluations that choose the start."""
        n = self.start_candidates
        return n + math.ceil(n / RETEST_ONE_IN) * RETESTS if n > 1 else 0

    @property
    def evaluations(self) -> int:
        """Evaluations of one generation: centre, +eps, and -eps if mirrored."""
        return self.population_size * (3 if self.mirrored_sampling else 2)


@dataclass(frozen=True, kw_only=True)
class SEHyperparameters(Validated):
    """The three networks of a synthetic environment."""

    hidden_layers: int = ranged(1, 2)
    hidden_size: int = ranged(1, 4096)
    activation: str = choice(ACTIVATIONS)


@dataclass(frozen=True, kw_only=True)
class DDQNHyperparameters(Validated):
    """Double DQN (van Hasselt et al., 2016), as the inner loop trains it."""

    init_episodes: int = ranged(0, 1_000_000)  # episodes before the first gradient step
    batch_size: int = ranged(1, 65536)
    learning_rate: float = ranged(1e-8, 1.0)  # of Adam
    target_update_rate: float = ranged(0.0, 1.0)  # of the soft update, per gradient step
    discount: float = ranged(0.0, 1.0)
    initial_epsilon: float = ranged(0.0, 1.0)  # in the first episode
    minimal_epsilon: float = ranged(0.0, 1.0)
    epsilon_decay: float = ranged(0.0, 1.0)  # factor per episode
    hidden_layers: int = ranged(1, 3)
    hidden_size: int = ranged(1, 4096)
    activation: str = choice(ACTIVATIONS)
    replay_capacity: int = ranged(1, 100_000_000, 100_000)
    max_episodes: int = ranged(1, 1_000_000, 1000)  # n_e
    early_out_episodes: int = ranged(1, 1_000_000, 10)  # d
    early_out_difference: float = ranged(0.0, 1e6, 0.01)  # C_diff
    test_episodes: int = ranged(1, 1_000_000, 10)  # n_te


@dataclass(frozen=True, kw_only=True)
class Hyperparameters:
    """Everything one NES run is given besides task and seed."""

    nes: NESHyperparameters
    se: SEHyperparameters
    agent: DDQNHyperparameters
    vary_agent: bool = False  # draw lr, batch size and network anew for every member

    def to_dict(self) -> dict[str, Any]:
        """Nested dictionary of plain values, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The inverse of `to_dict`. Raises InvalidInput."""
        try:
            return cls(
                nes=NESHyperparameters.from_dict(values["nes"]),
                se=SEHyperparameters.from_dict(values["se"]),
                agent=DDQNHyperparameters.from_dict(values["agent"]),
                vary_agent=bool(values.get("vary_agent", False)),
            )
        except (KeyError, TypeError) as error:
            raise InvalidInput(f"hyperparameters lack the section {error}") from None
