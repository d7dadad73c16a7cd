"""Write the tables of README.md and of docs from the committed results.

python -m benchmarks.readme
"""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks import paper
from benchmarks.agents.baseline import baseline
from benchmarks.agents.sb3 import sb3
from benchmarks.faults import faults
from benchmarks.machine import NotMeasured
from benchmarks.markdown import table
from benchmarks.nes import tables as nes
from benchmarks.nes.rewards import rewards
from benchmarks.search import comparison, recipes, studies
from benchmarks.speed.cost import cost
from benchmarks.speed.inner_loop import inner_loop
from benchmarks.speed.real_env import real_env
from benchmarks.speed.startup import startup
from benchmarks.speed.vector_env import vector_env
from bilevel.zoo import ENTRIES, card, env_id

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"


def zoo() -> str:
    """Return the table of the zoo's cards."""
    head = ["SE", "real steps to learn it", "agents trained on it", "mean return"]
    rows = [
        (
            f"`{env_id(entry.name)}`",
            f"{entry.real_env_steps:,}".replace(",", " "),
            f"{row.agents} {row.agent}",
            f"{row.mean_return} ± {row.std_return}",
            f"{row.solved_fraction:.0%}",
            f"{row.train_steps:.0f}",
        )
        for entry in map(card, ENTRIES)
        for row in entry.scores
    ]
    return table([*head, "solve the task", "train steps"], rows)


#: The documents and their tables, by the names of the markers.
DOCUMENTS: dict[Path, dict[str, Callable[[], str]]] = {
    ROOT / "README.md": {
        "inner-loop": inner_loop,
        "nes-seeds": nes.seeds,
    },
    DOCS / "agents.md": {
        "baseline-cartpole": partial(baseline, "CartPole-v0"),
        "baseline-acrobot": partial(baseline, "Acrobot-v1"),
    },
    DOCS / "experiments.md": paper.TABLES,
    DOCS / "nes.md": nes.TABLES | {"nes-rewards": rewards},
    DOCS / "tasks.md": {"nes-others": nes.others},
    DOCS / "tuning.md": {
        "search": comparison.methods,
        "searches": studies.searches,
        "found": recipes.found,
    },
    DOCS / "speed.md": {
        "inner-loop": inner_loop,
        "startup": startup,
        "vector-env": vector_env,
        "real-env": real_env,
        "cost": cost,
    },
    DOCS / "reliability.md": {"faults": faults},
    DOCS / "zoo.md": {"zoo": zoo, "sb3": sb3},
}


def fill(text: str, tables: dict[str, Callable[[], str]]) -> str:
    """Return a document's text with regenerated tables."""
    for name, make in tables.items():
        try:
            content = make()
        except NotMeasured as missing:
            content = f"*Not measured yet: {missing}*"
        block = f"<!-- {name} -->\n{content}\n<!-- /{name} -->"
        pattern = rf"<!-- {name} -->(?:.*?<!-- /{name} -->)?"
        text = re.sub(pattern, lambda _, block=block: block, text, flags=re.DOTALL)  # type: ignore[misc]
    return text


if __name__ == "__main__":
    for document, tables in DOCUMENTS.items():
        document.write_text(fill(document.read_text(), tables))
