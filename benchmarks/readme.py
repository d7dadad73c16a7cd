"""Write the tables of README.md and of docs from the committed results.

python -m benchmarks.readme
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import agent_tables, nes_tables
from benchmarks import speed_tables as speed
from benchmarks.faults import tables as faults
from benchmarks.machine import NotMeasured, read_result
from benchmarks.scaling import tables as scaling

ROOT = Path(__file__).parent.parent


def _where(result: dict[str, Any]) -> str:
    machine = result["machine"]
    return f"{machine['cores']} cores of {machine['processor']}; `{result['command']}`"


def inner_loop() -> str:
    """Kernel against definition."""
    result = read_result("inner_loop")
    rows = ["| agent | compiled | torch definition | ratio |", "| --- | --- | --- | --- |"]
    for name, case in result["results"].items():
        kernel, torch, ratio = case["kernel_us"], case["torch_us"], case["ratio"]
        rows.append(
            f"| {name} | {kernel['median']:.0f} µs | {torch['median']:.0f} µs | "
            f"{ratio['median']:.1f} ({ratio['low']:.1f} to {ratio['high']:.1f}) |"
        )
    rows.append(f"\nMedians of {result['repeats']} pairs, the ratio with its spread; one core.")
    rows.append(f"({_where(result)})")
    return "\n".join(rows)


def bohb() -> str:
    """One study of the local profile."""
    result = read_result("bohb_CartPole-v0")
    final = result["best_se"]
    rows = [
        "| budget | results | best objective | median objective | median, model's picks | "
        "median, random picks |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for budget, groups in result["objective_by_budget"].items():
        cells = [groups["all"]["results"], groups["all"]["best"], groups["all"]["median"]]
        cells += [
            f"{groups[kind]['median']} (of {groups[kind]['results']})"
            if groups[kind]["results"]
            else "-"
            for kind in ("model", "random")
        ]
        rows.append(f"| {budget} | {' | '.join(map(str, cells))} |")
    rows.append(
        f"\nOne study, {result['configurations']} configurations, {result['model_based_picks']} of "
        f"them proposed by the model, {result['failed']} failed. Fresh agents on its best SE score "
        f"{final['final_score_mean']:.1f} after {final['final_train_steps_mean']:.0f} steps."
    )
    rows.append(f"({_where(result)})")
    return "\n".join(rows)


#: The documents, and the tables in each by the name of their place in it.
DOCUMENTS: dict[Path, dict[str, Callable[[], str]]] = {
    ROOT / "README.md": {"bohb": bohb, "inner-loop": inner_loop, "nes-seeds": nes_tables.defaults},
    ROOT / "docs" / "agents.md": agent_tables.TABLES,
    ROOT / "docs" / "nes.md": nes_tables.TABLES,
    ROOT / "docs" / "scaling.md": scaling.TABLES,
    ROOT / "docs" / "speed.md": speed.TABLES,
    ROOT / "docs" / "reliability.md": faults.TABLES,
}


def filled(text: str, tables: dict[str, Callable[[], str]]) -> str:
    """A document's text with all tables made anew."""
    for name, table in tables.items():
        try:
            content = table()
        except NotMeasured as missing:
            content = f"*Not measured yet: {missing}*"
        block = f"<!-- {name} -->\n{content}\n<!-- /{name} -->"
        pattern = rf"<!-- {name} -->(?:.*?<!-- /{name} -->)?"
        text = re.sub(pattern, lambda _, block=block: block, text, flags=re.DOTALL)  # type: ignore[misc]
    return text


if __name__ == "__main__":
    for document, tables in DOCUMENTS.items():
        document.write_text(filled(document.read_text(), tables))
