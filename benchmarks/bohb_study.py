"""What a study found, from its journal: the best against the median configuration, and
what the model proposed against what was drawn at random.

    make bohb-cartpole ARGS="--home /tmp/runs --time-budget 22m"
    python -m benchmarks.bohb_study /tmp/runs/CartPole-v0/bohb-local-core-seed0
"""

import argparse
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.machine import write_result
from bilevel.synthetic_env import load_se
from cluster.bohb import Journal


def _summary(objectives: Sequence[float]) -> dict[str, float | int | None]:
    return {
        "results": len(objectives),
        "median": round(statistics.median(objectives), 1) if objectives else None,
        "best": round(max(objectives), 1) if objectives else None,
    }


def main() -> None:
    """Summarise a study's folder into `results/bohb_TASK.json`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    folder: Path = parser.parse_args().folder
    journal = Journal(folder)
    picks = {line.id: bool(line.info.get("model_based_pick")) for line in journal.configs}
    budgets = sorted({line.budget for line in journal.results})
    by_budget: dict[str, Any] = {}
    for budget in budgets:
        at = [line for line in journal.results if line.budget == budget and line.loss is not None]
        by_budget[str(budget)] = {
            "all": _summary([-line.loss for line in at if line.loss is not None]),
            "model": _summary([-x.loss for x in at if x.loss is not None and picks[x.id]]),
            "random": _summary([-x.loss for x in at if x.loss is not None and not picks[x.id]]),
        }
    task = folder.parent.name
    final = load_se(folder / "best_se.safetensors").info
    path = write_result(
        f"bohb_{task}",
        'make bohb-cartpole ARGS="--time-budget 22m"; python -m benchmarks.bohb_study FOLDER',
        {
            "configurations": len(picks),
            "model_based_picks": sum(picks.values()),
            "failed": sum(line.loss is None for line in journal.results),
            "objective_by_budget": by_budget,
            "best_se": {k: round(v, 3) for k, v in final.items() if k.startswith("final_")},
        },
    )
    print(path.read_text())


if __name__ == "__main__":
    main()
