r"""Trains agents with varied hyperparameters on the real task, as the baseline for SEs and as a
check of the agents against the authors' figures.

    python -m benchmarks.agents.baseline CartPole-v0 --agents 40 --home FOLDER
    python -m benchmarks.agents.baseline Acrobot-v1 --agents 40 --kinds ddqn,dueling-ddqn \
        --home FOLDER
"""

import argparse
from pathlib import Path

from benchmarks.machine import write_result
from bilevel.evaluation import RealTask
from bilevel.hyperparameters import AgentHyperparameters, default_agents
from bilevel.tasks import BUILT_IN_TASKS, get_task
from cluster.evaluate.command import EvaluateCommand, run_evaluate
from cluster.evaluate.report import Group, as_json
from cluster.experiments.authors import authors_figures
from cluster.session.context import RunContext
from cluster.storage.home import Home


def authors(task_id: str, agent: str) -> dict[str, float | None]:
    """Mean and standard deviation of train steps, and mean test return (None: not published), of
    the authors' 40 times 10 agents on the real task."""
    row = {"agent": agent, "source": "real"}
    found = {one.what: one for one in authors_figures() if (one.task, one.row) == (task_id, row)}
    steps, score = found["train_steps"], found.get("test_return")
    return {
        "train_steps_mean": steps.value,
        "train_steps_std": steps.spread,
        "score": None if score is None else score.value,
    }


def worst_by_layers(
    command: EvaluateCommand, hp: AgentHyperparameters, group: Group
) -> dict[int, list[int]]:
    """Per number of hidden layers: agents with the worst return in every test, and all agents."""
    found: dict[int, list[int]] = {}
    for i, result in enumerate(group.results):
        agent = command.request(0, hp, i, RealTask()).agent
        counts = found.setdefault(getattr(agent, "hidden_layers", 0), [0, 0])
        counts[0] += max(result.test_returns) <= command.task.worst_score
        counts[1] += 1
    return dict(sorted(found.items()))


def main() -> None:
    """Train the agents, write `results/baseline_TASK.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=[*BUILT_IN_TASKS])
    parser.add_argument("--agents", type=int, default=40)
    parser.add_argument("--kinds", default="ddqn,dueling-ddqn,td3")
    parser.add_argument("--home", type=Path, required=True)
    options = parser.parse_args()
    task = get_task(options.task)
    kinds = tuple(options.kinds.split(","))
    home = Home(options.home)
    command = EvaluateCommand(
        task,
        {"real": None},
        default_agents(kinds),
        options.agents,
        "all",
        0,
        "baseline",
        RunContext(home, home.database_uri),
    )
    groups = run_evaluate(command)
    rows = as_json(groups)
    for row, hp, group in zip(rows, command.kinds, groups, strict=True):
        row["worst_by_layers"] = worst_by_layers(command, hp, group)
        row["authors"] = authors(task.id, row["agent"])
    line = (
        f"python -m benchmarks.agents.baseline {options.task} --agents {options.agents} "
        f"--kinds {options.kinds} --home FOLDER"
    )
    print(f"written to {write_result(f'baseline_{task.id}', line, {'groups': rows})}")


if __name__ == "__main__":
    main()
