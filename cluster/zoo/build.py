"""`bilevel zoo build`: an NES run, then an evaluation of its SE, and the card of both."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from bilevel.durable import write_aside
from bilevel.hyperparameters import default_agents, load_recipe
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from bilevel.zoo import Card, Entry, Taught
from cluster.evaluate.command import EvaluateCommand, run_evaluate
from cluster.evaluate.report import Group
from cluster.nes.command import NESCommand, run_nes
from cluster.nes.run import NESRun
from cluster.session.context import RunContext
from cluster.storage.home import require_writable
from cluster.storage.run_folder import BEST_FILE

#: Kinds of agents that are trained on an SE of the zoo, and the number of each.
KINDS, AGENTS = ("ddqn", "dueling-ddqn", "td3"), 50


@dataclass(frozen=True)
class BuildCommand:
    """An SE of the zoo, and how and where this command makes it."""

    entry: Entry
    context: RunContext
    folder: Path  # for the SE and its card
    agents: int = AGENTS  # of each kind
    workers: int | None = None  # actors; None: one per core of this run's share


def build(command: BuildCommand) -> Card:
    """Make the SE and its card, and write both; interrupted, the same command resumes.

    Raises InvalidInput before anything is written.
    """
    entry, context = command.entry, command.context
    task, hp = get_task(entry.task), load_recipe(entry.recipe, entry.task)
    require_writable(command.folder)
    run_folder = context.home.run_folder(task.id, f"zoo-{entry.name}")
    run_nes(NESCommand(NESRun(task, hp, entry.seed, run_folder), context, command.workers))
    se = load_se(run_folder / BEST_FILE)
    kinds = default_agents(KINDS)
    groups = run_evaluate(
        EvaluateCommand(
            task,
            {entry.name: se},
            kinds,
            command.agents,
            "all",
            0,
            f"zoo-{entry.name}-agents",
            context,
            command.workers,
        )
    )
    command.folder.mkdir(parents=True, exist_ok=True)
    path = command.folder / f"{entry.name}.safetensors"
    write_aside(path, (run_folder / BEST_FILE).read_bytes())
    made = Card(
        entry.name,
        task.id,
        entry.recipe,
        entry.seed,
        str(se.info["bilevel_version"]),
        (
            f"bilevel nes {task.id} --recipe {entry.recipe} --seed {entry.seed}",
            f"bilevel evaluate {path.name} --agent {','.join(KINDS)} --agents {command.agents} "
            "--vary-hp all",
        ),
        int(se.info["real_env_steps"]),
        hashlib.sha256(path.read_bytes()).hexdigest(),
        tuple(_taught(group) for group in groups),
    )
    card = json.dumps(asdict(made), indent=2) + "\n"
    write_aside(path.with_suffix(".json"), card.encode())
    return made


def _taught(group: Group) -> Taught:
    return Taught(
        group.agent,
        len(group.results),
        round(float(group.scores.mean()), 1),
        round(float(group.scores.std()), 1),
        round(group.summary()["solved_fraction"], 2),
        round(float(group.train_steps.mean())),
    )
