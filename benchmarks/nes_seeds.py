"""`bilevel nes` with its defaults over several seeds: solved or not, how fast.

python -m benchmarks.nes_seeds CartPole-v0 --seeds 5 --home /tmp/runs
"""

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.machine import write_result
from bilevel.nes import NESState
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task


def run_seed(task_id: str, seed: int, home: Path, generations: int) -> dict[str, Any]:
    """One run, as a user starts it."""
    name = f"seed{seed}"
    script = Path(sys.executable).with_name("bilevel")
    command: list[str | Path] = [
        script,
        "nes",
        task_id,
        "--seed",
        str(seed),
        "--name",
        name,
        "--home",
        home,
    ]
    started = time.perf_counter()
    subprocess.run([*command, "--generations", str(generations)], check=True)
    minutes = (time.perf_counter() - started) / 60
    folder = home / task_id / name
    state = NESState.load(folder / "state.safetensors")
    final = load_se(folder / "best_se.safetensors").info
    solved_reward = get_task(task_id).solved_reward
    solved_at = next((r.generation for r in state.records if r.score_mean >= solved_reward), None)
    return {
        "seed": seed,
        "generations": state.generation,
        "first_solved_generation": solved_at,
        "minutes": round(minutes, 2),
        "final_score_mean": round(final["final_score_mean"], 1),
        "final_train_steps_mean": round(final["final_train_steps_mean"]),
        "solved": final["final_score_mean"] >= solved_reward,
        "score_curve": [round(r.score_mean, 1) for r in state.records],
    }


def main() -> None:
    """Run all seeds, print a table, write `results/nes_seeds_TASK.json`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("task")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--generations", type=int, default=60)
    parser.add_argument("--home", type=Path, required=True)
    args = parser.parse_args()
    rows = []
    for seed in range(args.seeds):
        rows.append(run_seed(args.task, seed, args.home, args.generations))
        solved = [row for row in rows if row["solved"]]
        path = write_result(
            f"nes_seeds_{args.task}",
            f"python -m benchmarks.nes_seeds {args.task} --seeds {args.seeds} "
            f"--generations {args.generations} --home FOLDER",
            {
                "solved": f"{len(solved)} of {len(rows)}",
                "median_minutes": statistics.median(row["minutes"] for row in rows),
                "runs": rows,
            },
        )
    print("| seed | generations | minutes | 10 fresh agents | train steps | solved |")
    print("| --- | --- | --- | --- | --- | --- |")
    for row in rows:
        print(
            f"| {row['seed']} | {row['generations']} | {row['minutes']:.1f} | "
            f"{row['final_score_mean']} | {row['final_train_steps_mean']} | {row['solved']} |"
        )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
