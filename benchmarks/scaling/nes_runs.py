"""Every evaluation of one NES run: steps and seconds, from the choice of the start to the
last generation.

    python -m benchmarks.scaling.nes_runs CartPole-v0 --seed 0 --generations 24 --home FOLDER

The state before every generation stays in FOLDER, for the other measurements.
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.machine import write_result
from benchmarks.scaling.evaluations import Processes, columns, processes
from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import load_preset
from bilevel.nes import NES, Psi
from bilevel.tasks import get_task


def generation_path(home: Path, task_id: str, seed: int, generation: int) -> Path:
    """Where the state before a generation is kept."""
    return home / f"{task_id}-seed{seed}" / f"generation-{generation:03d}.safetensors"


def record(nes: NES, generations: int, workers: Processes, home: Path) -> dict[str, Any]:
    """The run; `between_seconds` (processor time) lie between the last answer of a
    generation and the first request of the next: update, state on disk, requests."""
    task, shape = nes.task, nes.architecture
    batches: list[Sequence[EvaluationResult]] = []

    def evaluate(
        psi: Psi | None, requests: Sequence[EvaluationRequest]
    ) -> Sequence[EvaluationResult]:
        batches.append(workers.run(task, shape, psi, requests))
        return batches[-1]

    state = nes.start(evaluate)
    *screened, retested = batches
    state.save(generation_path(home, task.id, nes.seed, 0))
    requests = nes.ask(state)
    rows: list[dict[str, Any]] = []
    for number in range(generations):
        results = workers.run(task, shape, state.psi, requests)
        started = time.thread_time()
        state = nes.tell(state, results, 0.0, 0.0)
        state.save(generation_path(home, task.id, nes.seed, number + 1))
        requests = nes.ask(state)
        between = time.thread_time() - started
        score = state.records[-1].score_mean
        rows.append(
            {
                "score": round(score, 1),
                "between_seconds": round(between, 4),
                **columns(task, results),
            }
        )
        print(f"generation {number}: score {score:.1f}", flush=True)
    return {
        "screening": columns(task, [result for batch in screened for result in batch]),
        "retests": columns(task, retested),
        "generations": rows,
    }


def main() -> None:
    """Record one run into `results/scaling_nes_TASK.json`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("task")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--generations", type=int, default=24)
    parser.add_argument("--home", type=Path, required=True)
    args = parser.parse_args()
    nes = NES(get_task(args.task), load_preset("tuned", args.task, "antithetic"), args.seed)
    generation_path(args.home, args.task, args.seed, 0).parent.mkdir(parents=True, exist_ok=True)
    with processes() as workers:
        values = record(nes, args.generations, workers, args.home)
    path = write_result(
        f"scaling_nes_{args.task}",
        f"python -m benchmarks.scaling.nes_runs {args.task} --seed {args.seed} "
        f"--generations {args.generations} --home FOLDER",
        {"task": args.task, "seed": args.seed, **values},
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
