"""The tables of docs/agents.md, from the committed results."""

from collections.abc import Callable
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


def _where(*results: dict[str, Any]) -> str:
    machine = results[0]["machine"]
    commands = ", ".join(f"`{result['command']}`" for result in results)
    return f"\n({machine['cores']} cores of {machine['processor']}; {commands})"


def baseline() -> str:
    """Agents on the real task, beside the authors' figures."""
    head = ("task", "agent", "agents", "test return", "solved", "train steps")
    rows = [_row(*head, "authors' return", "authors' train steps"), _row(*["---"] * 8)]
    results = [read_result(f"baseline_{task}") for task in ("CartPole-v0", "Acrobot-v1")]
    for task, result in zip(("CartPole-v0", "Acrobot-v1"), results, strict=True):
        for group in result["groups"]:
            authors = group["authors"]
            score = "-" if authors["score"] is None else f"{authors['score']:.1f}"
            steps = f"{authors['train_steps_mean']} ± {authors['train_steps_std']}"
            agents = f"{group['agents']:.0f}"
            rows.append(_row(task, group["agent"], agents, *_measured(group), score, steps))
    rows.append("\n*Test return* is over ten test episodes of each agent, *solved* the fraction of")
    rows.append("agents whose ten average the solved reward; mean ± standard deviation. The")
    rows.append("authors' figures are from the plotting scripts of their repository.")
    return "\n".join(rows) + _where(*results)


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


TABLES: dict[str, Callable[[], str]] = {"baseline": baseline, "transfer": transfer}
