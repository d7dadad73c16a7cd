"""The zoo: SEs that are part of this package, learned by NES from scores alone.

    import bilevel, gymnasium
    env = gymnasium.make("bilevel/Synthetic-CartPole-v0")
    se = bilevel.load("CartPole-v0")

This folder contains `NAME.safetensors`, the SE, and `NAME.json`, its card with results.
`bilevel zoo build NAME` creates both.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from bilevel.errors import unknown_value

_FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class AgentScores:
    """Results of fresh agents of one kind, trained on the SE with hyperparameters drawn from the
    paper's ranges (`bilevel.agents.variation`)."""

    agent: str
    agents: int
    mean_return: float  # on the real task
    std_return: float  # over agents, each with its mean over test episodes
    solved_fraction: float  # of the agents, those whose mean return solves the task
    train_steps: float  # mean over agents, on the SE


@dataclass(frozen=True)
class Card:
    """Origin and results of an SE of the zoo."""

    name: str
    task: str
    recipe: str
    seed: int
    version: str  # of this package
    commands: tuple[str, ...]  # that learned the SE and trained the agents
    real_env_steps: int  # used to learn the SE, including its confirmation and retests
    sha256: str  # of the SE file
    scores: tuple[AgentScores, ...]


@dataclass(frozen=True)
class Entry:
    """The run that learns an SE of the zoo."""

    name: str
    task: str
    seed: int = 0
    recipe: str = "default"


#: All SEs of the zoo by name.
ENTRIES = {
    name: Entry(name, name) for name in ("CartPole-v0", "Acrobot-v1", "MountainCarContinuous-v0")
}


def env_id(name: str) -> str:
    """Return the gymnasium id of an SE of the zoo."""
    return f"bilevel/Synthetic-{name}"


def get_entry(name: str) -> Entry:
    """Return an entry by name. Raises InvalidInput for an unknown name."""
    if name not in ENTRIES:
        raise unknown_value("SE of the zoo", name, ENTRIES)
    return ENTRIES[name]


def zoo_file(name: str) -> Path:
    """Return the file of an SE of the zoo. Raises InvalidInput for an unknown name."""
    return _FOLDER / f"{get_entry(name).name}.safetensors"


@cache
def card(name: str) -> Card:
    """Return the card of an SE of the zoo. Raises InvalidInput for an unknown name."""
    from bilevel.decode import decode_file

    return decode_file(Card, zoo_file(name).with_suffix(".json"), "the card")
