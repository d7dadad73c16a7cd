"""Write the tables of README.md and of docs from the committed results.

python -m benchmarks.readme
"""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks import paper
from benchmarks.agents import tables as agents
from benchmarks.agents.sb3 import sb3
from benchmarks.faults import tables as faults
from benchmarks.machine import NotMeasured
from benchmarks.markdown import table
from benchmarks.nes import tables as nes
from benchmarks.search import tables as search
from benchmarks.search.cards import FILE as CARDS
from benchmarks.search.cards import cards
from benchmarks.speed import tables as speed
from bilevel.zoo import ENTRIES, card

ROOT = Path(__file__).parent.parent


def zoo() -> str:
    """The cards of the zoo."""
    head = ["SE", "real steps to learn it", "agents trained on it", "mean return"]
    rows = [
        (
            f"`{told.env_id}`",
            f"{told.real_env_steps:,}".replace(",", " "),
            f"{taught.agents} {taught.agent}",
            f"{taught.mean_return} ± {taught.std_return}",
            f"{taught.solved_fraction:.0%}",
            f"{taught.train_steps:.0f}",
        )
        for told in map(card, ENTRIES)
        for taught in told.taught
    ]
    return table([*head, "solve the task", "train steps"], rows)


#: The documents and their tables, by the names of the markers.
DOCUMENTS: dict[Path, dict[str, Callable[[], str]]] = {
    ROOT / "README.md": {
        "inner-loop": partial(speed.inner_loop, bound=False),
        "nes-seeds": nes.seeds,
    },
    CARDS: {"cards": cards},
    ROOT / "docs" / "agents.md": agents.TABLES,
    ROOT / "docs" / "experiments.md": paper.TABLES,
    ROOT / "docs" / "nes.md": nes.TABLES,
    ROOT / "docs" / "other-tasks.md": {"nes-others": nes.others},
    ROOT / "docs" / "tuning.md": search.TABLES,
    ROOT / "docs" / "speed.md": speed.TABLES,
    ROOT / "docs" / "reliability.md": faults.TABLES,
    ROOT / "docs" / "zoo.md": {"zoo": zoo, "sb3": sb3},
}


def filled(text: str, tables: dict[str, Callable[[], str]]) -> str:
    """A document's text with all tables regenerated."""
    for name, made in tables.items():
        try:
            content = made()
        except NotMeasured as missing:
            content = f"*Not measured yet: {missing}*"
        block = f"<!-- {name} -->\n{content}\n<!-- /{name} -->"
        pattern = rf"<!-- {name} -->(?:.*?<!-- /{name} -->)?"
        text = re.sub(pattern, lambda _, block=block: block, text, flags=re.DOTALL)  # type: ignore[misc]
    return text


if __name__ == "__main__":
    for document, tables in DOCUMENTS.items():
        document.write_text(filled(document.read_text(), tables))
