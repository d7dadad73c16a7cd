"""The tables of docs/agents.md, from the committed results."""

from collections.abc import Callable
from functools import partial
from typing import Any

from benchmarks.machine import read_result


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _measured(group: dict[str, Any]) -> list[str]:
    return [
        f"{group['test_returns_mean']:.1f} ± {group['test_returns_std']:.1f}",
        f"{group['solved_fraction']:.0%}",
        f"{group['train_steps_mean']:.0f} ± {group['train_steps_std']:.0f}",
    ]


def _where(result: dict[str, Any]) -> str:
    machine = result["machine"]
    return f"\n({machine['cores']} cores of {machine['processor']}; `{result['command']}`)"


def baseline(task: str) -> str:
    """Agents on the real task, beside the authors' figures."""
    head = ("agent", "agents", "test return", "solved", "train steps")
    rows = [_row(*head, "authors' return", "authors' train steps"), _row(*["---"] * 7)]
    result = read_result(f"baseline_{task}")
    for group in result["groups"]:
        authors = group["authors"]
        score = "-" if authors["score"] is None else f"{authors['score']:.1f}"
        steps = f"{authors['train_steps_mean']} ± {authors['train_steps_std']}"
        agents = f"{group['agents']:.0f}"
        rows.append(_row(group["agent"], agents, *_measured(group), score, steps))
    for group in result["groups"]:
        stuck = group.get("worst_by_layers", {})
        if any(worst for worst, _ in stuck.values()):
            counts = ", ".join(f"{worst} of {of}" for worst, of in stuck.values())
            rows.append(
                f"\nThe worst return in every test, {group['agent']} of {', '.join(stuck)} hidden "
                f"layers: {counts}."
            )
    return "\n".join(rows) + "\n" + _where(result)


def transfer() -> str:
    """Agents on an SE."""
    result = read_result("transfer_CartPole-v0")
    rows = [
        _row("agent", "hyperparameters", "agents", "test return", "solved", "train steps"),
        _row(*["---"] * 6),
    ]
    for group in result["groups"]:
        kind = "varied" if group["varied"] else "default"
        rows.append(_row(group["agent"], kind, f"{group['agents']:.0f}", *_measured(group)))
    rows.append(
        f"\nOne SE for CartPole-v0, learned with DDQN at fixed hyperparameters in "
        f"{result['generations']} generations, seed 0."
    )
    return "\n".join(rows) + _where(result)


TABLES: dict[str, Callable[[], str]] = {
    "baseline-cartpole": partial(baseline, "CartPole-v0"),
    "baseline-acrobot": partial(baseline, "Acrobot-v1"),
    "transfer": transfer,
}
