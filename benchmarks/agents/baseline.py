r"""Train agents with varied hyperparameters on the real task, as a baseline for SEs.

The table compares them with the authors' agents.

    python -m benchmarks.agents.baseline CartPole-v0 --agents 40 --home FOLDER
    python -m benchmarks.agents.baseline Acrobot-v1 --agents 40 --kinds ddqn,dueling-ddqn \
        --home FOLDER
"""

import argparse
from pathlib import Path
from typing import Any

from benchmarks.machine import read_result, write_result
from benchmarks.markdown import source, table
from bilevel.hyperparameters import AgentHyperparameters, default_agents
from bilevel.tasks import BUILT_IN_TASKS, get_task
from cluster.evaluate.command import EvaluateCommand, run_evaluate
from cluster.evaluate.report import Group, as_json
from cluster.experiments.authors import authors_figures
from cluster.session.context import RunContext
from cluster.storage.home import Home


def authors(task_id: str, agent: str) -> dict[str, float | None]:
    """Return the authors' train steps and mean test return (None: not published).

    They trained 40 times 10 agents on the real task.
    """
    row = {"agent": agent, "source": "real"}
    found = {
        figure.what: figure
        for figure in authors_figures()
        if (figure.task, figure.row) == (task_id, row)
    }
    steps, score = found["train_steps"], found.get("test_return")
    return {
        "train_steps_mean": steps.value,
        "train_steps_std": steps.spread,
        "score": None if score is None else score.value,
    }


def worst_by_layers(
    command: EvaluateCommand, hp: AgentHyperparameters, group: Group
) -> dict[int, list[int]]:
    """Count the agents with the worst return in every test, and all agents, by hidden layers."""
    counts: dict[int, list[int]] = {}
    for i, result in enumerate(group.results):
        agent, _ = command.agent(hp, i)
        count = counts.setdefault(getattr(agent, "hidden_layers", 0), [0, 0])
        count[0] += max(result.test_returns) <= command.task.worst_score
        count[1] += 1
    return dict(sorted(counts.items()))


def baseline(task: str) -> str:
    """Return the table of a task, with the authors' results, and notes on agents that failed."""
    head = ["agent", "agents", "test return", "solved", "train steps"]
    head += ["authors' return", "authors' train steps"]
    result = read_result(f"baseline_{task}")
    notes = "".join(map(_note, result["groups"]))
    return f"{table(head, map(_row, result['groups']))}{notes}\n\n{source(result)}"


def _row(group: dict[str, Any]) -> list[str]:
    authors = group["authors"]
    return [
        group["agent"],
        f"{group['agents']:.0f}",
        f"{group['test_returns_mean']:.1f} ± {group['test_returns_std']:.1f}",
        f"{group['solved_fraction']:.0%}",
        f"{group['train_steps_mean']:.0f} ± {group['train_steps_std']:.0f}",
        "-" if authors["score"] is None else f"{authors['score']:.1f}",
        f"{authors['train_steps_mean']} ± {authors['train_steps_std']}",
    ]


def _note(group: dict[str, Any]) -> str:
    counts = group.get("worst_by_layers", {})
    if not any(worst for worst, _ in counts.values()):
        return ""
    listed = ", ".join(f"{worst} of {of} with {layers}" for layers, (worst, of) in counts.items())
    return (
        f"\n\nOf the {group['agent']} agents, by hidden layers, {listed} had the worst "
        "return in every test."
    )


def main() -> None:
    """Train the agents and write `results/baseline_TASK.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=[*BUILT_IN_TASKS])
    parser.add_argument("--agents", type=int, default=40)
    parser.add_argument("--kinds", default="ddqn,dueling-ddqn,td3")
    parser.add_argument("--home", type=Path, required=True)
    options = parser.parse_args()
    task, kinds = get_task(options.task), default_agents(options.kinds.split(","))
    home = Home(options.home)
    context = RunContext(home, home.database_uri)
    command = EvaluateCommand(
        task, {"real": None}, {"real": kinds}, options.agents, "all", 0, "baseline", context
    )
    groups = run_evaluate(command)
    rows = as_json(groups)
    for row, hp, group in zip(rows, kinds, groups, strict=True):
        row["worst_by_layers"] = worst_by_layers(command, hp, group)
        row["authors"] = authors(task.id, row["agent"])
    line = (
        f"python -m benchmarks.agents.baseline {options.task} --agents {options.agents} "
        f"--kinds {options.kinds} --home FOLDER"
    )
    write_result(f"baseline_{task.id}", line, {"groups": rows})


if __name__ == "__main__":
    main()
