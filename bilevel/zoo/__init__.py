"""The zoo: SEs that come with this package, learned by NES from scores alone, and their cards.

    import bilevel, gymnasium
    env = gymnasium.make("bilevel/Synthetic-CartPole-v0")
    se = bilevel.load("CartPole-v0")

The files lie beside this module: `NAME.safetensors`, the SE, and `NAME.json`, its card.
`bilevel zoo build NAME` makes both anew.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from bilevel.errors import one_of

_FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Taught:
    """Results of fresh agents of one kind, trained on the SE with hyperparameters drawn from the
    paper's ranges (`bilevel.agents.variation`)."""

    agent: str
    agents: int
    mean_return: float  # on the real task
    std_return: float  # over agents, each with its mean over test episodes
    solved_fraction: float  # share of the agents whose mean return solves the task
    train_steps: float  # mean over agents, on the SE


@dataclass(frozen=True)
class Card:
    """The card of an SE of the zoo."""

    name: str
    task: str
    recipe: str
    seed: int
    version: str  # of this package, which learned it
    commands: tuple[str, ...]  # that learned it, and that trained the agents
    real_env_steps: int  # made to learn it, its confirmation and retests included
    sha256: str  # of the file
    taught: tuple[Taught, ...]

    @property
    def env_id(self) -> str:
        """Its id in gymnasium."""
        return env_id(self.name)


@dataclass(frozen=True)
class Entry:
    """The run that makes an SE of the zoo."""

    name: str
    task: str
    seed: int
    recipe: str = "default"


#: All SEs of the zoo by name.
ENTRIES = {
    entry.name: entry
    for entry in (Entry("CartPole-v0", "CartPole-v0", 441), Entry("Acrobot-v1", "Acrobot-v1", 473))
}


def label(name: str) -> str:
    """What the SE with that name is called beside its real task, which has the same name."""
    return f"Synthetic-{name}"


def env_id(name: str) -> str:
    """The id in gymnasium of the SE with that name."""
    return f"bilevel/{label(name)}"


def get_entry(name: str) -> Entry:
    """The entry with that name. Raises InvalidInput for another name."""
    if name not in ENTRIES:
        raise one_of("SE of the zoo", name, ENTRIES)
    return ENTRIES[name]


def zoo_file(name: str) -> Path:
    """The file of the SE with that name. Raises InvalidInput for another name."""
    return _FOLDER / f"{get_entry(name).name}.safetensors"


@cache
def card(name: str) -> Card:
    """The card of the SE with that name. Raises InvalidInput for another name."""
    from bilevel.decode import decode_file

    return decode_file(Card, zoo_file(name).with_suffix(".json"), "the card")
