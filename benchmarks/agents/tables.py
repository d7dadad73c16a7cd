"""The tables of docs/agents.md, from the committed results."""

from collections.abc import Callable
from functools import partial
from typing import Any

from benchmarks.machine import read_result
from benchmarks.markdown import source, table


def _measured(group: dict[str, Any]) -> list[str]:
    return [
        f"{group['test_returns_mean']:.1f} ± {group['test_returns_std']:.1f}",
        f"{group['solved_fraction']:.0%}",
        f"{group['train_steps_mean']:.0f} ± {group['train_steps_std']:.0f}",
    ]


def baseline(task: str) -> str:
    """Agents on the real task, beside the authors' figures."""
    head = ["agent", "agents", "test return", "solved", "train steps"]
    result = read_result(f"baseline_{task}")
    rows, notes = [], ""
    for group in result["groups"]:
        authors = group["authors"]
        score = "-" if authors["score"] is None else f"{authors['score']:.1f}"
        steps = f"{authors['train_steps_mean']} ± {authors['train_steps_std']}"
        agents = f"{group['agents']:.0f}"
        rows.append([group["agent"], agents, *_measured(group), score, steps])
        stuck = group.get("worst_by_layers", {})
        if any(worst for worst, _ in stuck.values()):
            counts = ", ".join(
                f"{worst} of {of} with {layers}" for layers, (worst, of) in stuck.items()
            )
            notes += (
                f"\n\nOf the {group['agent']} agents, by hidden layers, {counts} had the worst "
                "return in every test."
            )
    whole = table([*head, "authors' return", "authors' train steps"], rows)
    return f"{whole}{notes}\n\n{source(result)}"


TABLES: dict[str, Callable[[], str]] = {
    "baseline-cartpole": partial(baseline, "CartPole-v0"),
    "baseline-acrobot": partial(baseline, "Acrobot-v1"),
}
