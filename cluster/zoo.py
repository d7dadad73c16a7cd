"""`bilevel zoo build`: an NES run, an evaluation of its SE, and the card of both."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from bilevel.durable import write_aside
from bilevel.recipes import load_recipe, usual_agents
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from bilevel.zoo import AgentScores, Card, Entry
from cluster.evaluate.command import EvaluateCommand, run_evaluate
from cluster.nes.command import run_nes
from cluster.nes.run import NESRun
from cluster.session.context import RunContext
from cluster.storage.home import require_writable
from cluster.storage.run_folder import BEST_FILE

#: Kinds of agents that the card of a task with discrete actions reports.
KINDS = ("ddqn", "dueling-ddqn", "td3")


def build(
    entry: Entry, context: RunContext, folder: Path, agents: int = 50, workers: int | None = None
) -> Card:
    """Build an SE and its card with `agents` agents of each kind, and write both to `folder`.
    The same call resumes. Raises InvalidInput before anything is written."""
    task = get_task(entry.task)
    hp = load_recipe(entry.recipe, task)
    require_writable(folder)
    run_folder = context.home.run_folder(task.id, f"zoo-{entry.name}")
    run_nes(NESRun(task, hp, entry.seed, run_folder), context, workers)
    content = (run_folder / BEST_FILE).read_bytes()
    se = load_se(run_folder / BEST_FILE)
    name = f"zoo-{entry.name}-agents"
    kinds = usual_agents(task, se.se.architecture.one_step, None if task.continuous else KINDS)
    command = EvaluateCommand(
        task, {entry.name: se}, {entry.name: kinds}, agents, "all", 0, name, context, workers
    )
    groups = run_evaluate(command)
    path, names = folder / f"{entry.name}.safetensors", ",".join(hp.agent for hp in kinds)
    card = Card(
        entry.name,
        task.id,
        entry.recipe,
        entry.seed,
        str(se.info["bilevel_version"]),
        (
            f"bilevel nes {task.id} --recipe {entry.recipe} --seed {entry.seed}",
            f"bilevel evaluate {path.name} --agent {names} --agents {agents} --vary-hp all",
        ),
        int(se.info["real_env_steps"]),
        hashlib.sha256(content).hexdigest(),
        tuple(
            AgentScores(
                group.agent,
                len(group.results),
                round(float(group.scores.mean()), 1),
                round(float(group.scores.std()), 1),
                round(group.summary()["solved_fraction"], 2),
                round(float(group.train_steps.mean())),
            )
            for group in groups
        ),
    )
    write_aside(path, content)
    write_aside(path.with_suffix(".json"), (json.dumps(asdict(card), indent=2) + "\n").encode())
    return card
