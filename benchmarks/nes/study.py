"""`bilevel nes` over seeds: with its defaults, and with one of them taken away at a time. How
many runs solve the task, when, whether they stay there, and what agents with varied
hyperparameters learn on their best SEs.

    python -m benchmarks.nes.study CartPole-v0 --variants defaults --seeds 0 1 2 --home FOLDER

Runs are ordinary runs of one worker, one a core at a time; started again, the call goes on
with what is missing. `results/nes_TASK.json` keeps the variants of earlier calls.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.machine import NotMeasured, machine, read_result, write_result
from bilevel.nes import GenerationRecord, NESState
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from cluster.final import BEST_FILE
from cluster.nes_loop import STATE_FILE
from cluster.run_folder import Begun, read_settings
from cluster.views.evaluation import REPORT_FILE

#: Kinds of agents that may be trained on the best SEs.
AGENTS = ("ddqn", "dueling-ddqn", "td3")

#: Options of `bilevel nes`.
VARIANTS: dict[str, list[str]] = {
    "defaults": [],
    "no step price": ["--set", "nes.step_price=0"],
    "mixed agents": ["--agent", ",".join(AGENTS)],
    "fixed agents": ["--vary-hp", "no"],
    "no choice of start": ["--start-candidates", "1"],
}


@dataclass(frozen=True)
class Study:
    """Runs of one task under one home."""

    task: str
    generations: int
    home: Path

    def folder(self, variant: str, seed: int) -> Path:
        """Of a run."""
        return self.home / self.task / f"{variant.replace(' ', '-').replace(',', '')}-{seed}"

    def run(self, variant: str, seed: int, transfers: int, agents: Sequence[str]) -> None:
        """One run as a user starts it, then fresh varied agents of these kinds on its best
        SE, so many of each."""
        folder = self.folder(variant, seed)
        common = ["--home", str(self.home), "--workers", "1"]
        options = ["--name", folder.name, "--seed", str(seed), *VARIANTS[variant], *common]
        if not (folder / BEST_FILE).exists():
            _bilevel("nes", self.task, "--generations", str(self.generations), *options)
        for agent in agents if transfers else ():
            name = self._transfer(variant, seed, agent).parent.name
            if not self._transfer(variant, seed, agent).exists():
                _bilevel(
                    "evaluate",
                    str(folder / BEST_FILE),
                    *["--agent", agent, "--agents", str(transfers), "--vary-hp", "all"],
                    *["--name", name, *common],
                )

    def hyperparameters(self, variant: str, seed: int) -> dict[str, Any]:
        """Of a run that has ended, but for the number of generations."""
        settings = read_settings(self.folder(variant, seed))
        return {name: settings[name] for name in ("nes", "se", "agents", "vary_agent")}

    def _transfer(self, variant: str, seed: int, agent: str) -> Path:
        """The report on agents of a kind on a run's best SE."""
        folder = self.folder(variant, seed)
        return folder.with_name(f"{folder.name}-{agent}") / REPORT_FILE

    def row(self, variant: str, seed: int) -> dict[str, Any] | None:
        """What came of a run; None if it has not ended."""
        folder = self.folder(variant, seed)
        if not (folder / BEST_FILE).exists():
            return None
        state, final = NESState.load(folder / STATE_FILE), load_se(folder / BEST_FILE).info
        solved_reward = get_task(self.task).solved_reward
        solved = [r.score_mean >= solved_reward for r in state.records]
        varied = {}
        for agent in AGENTS:
            report = self._transfer(variant, seed, agent)
            if report.exists():
                (group,) = json.loads(report.read_text())
                varied[agent] = {
                    "score_mean": round(group["test_returns_mean"], 1),
                    "solved_fraction": round(group["solved_fraction"], 2),
                    "train_steps_mean": round(group["train_steps_mean"]),
                    "agents": round(group["agents"]),
                }
        first = solved.index(True) if any(solved) else None
        return {
            "seed": seed,
            "generations": state.generation,
            "first_solved_generation": first,
            "solved_since": None if first is None else round(statistics.mean(solved[first:]), 2),
            "minutes": round(seconds(state.records, Begun.read(folder).time) / 60, 2),
            "final_score_mean": round(final["final_score_mean"], 1),
            "final_train_steps_mean": round(final["final_train_steps_mean"]),
            "varied": varied,
            "score_curve": [round(r.score_mean, 1) for r in state.records],
            "steps_curve": [round(r.train_steps_mean) for r in state.records],
            "std_dev_curve": [round(r.std_dev, 4) for r in state.records],
        }


def seconds(records: Sequence[GenerationRecord], begun: float) -> float:
    """That a run ran, its start included; it may have stood still between generations."""
    first = records[0]
    start = first.finished - first.generation_seconds - begun
    return start + sum(record.generation_seconds for record in records)


def _bilevel(*arguments: str) -> None:
    script = Path(sys.executable).with_name("bilevel")
    done = subprocess.run([script, *arguments], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"bilevel {' '.join(arguments)}: {done.stderr}")
    print(arguments[0], arguments[arguments.index("--name") + 1], *done.stdout.splitlines()[-5:-4])


def commands(study: Study, variant: str, rows: Sequence[dict[str, Any]]) -> list[str]:
    """That measure these rows: all runs, and one more for agents that were trained on the best
    SEs of other runs, or in another number."""
    calls: dict[tuple[str, int], list[str]] = {}
    everywhere = " ".join(str(row["seed"]) for row in rows)
    for agent in AGENTS:
        found = [row for row in rows if agent in row["varied"]]
        for number in {row["varied"][agent]["agents"] for row in found}:
            seeds = [row["seed"] for row in found if row["varied"][agent]["agents"] == number]
            calls.setdefault((" ".join(map(str, seeds)), number), []).append(agent)
    if not any(seeds == everywhere for seeds, _ in calls):
        calls = {(everywhere, 0): ["ddqn"], **calls}
    return [
        f"python -m benchmarks.nes.study {study.task} --variants '{variant}' --seeds {seeds} "
        f"--generations {study.generations} --transfers {number} --agents {' '.join(agents)} "
        "--home FOLDER"
        for (seeds, number), agents in calls.items()
    ]


def write(study: Study, variants: Sequence[str], seeds: Sequence[int]) -> Path:
    """The results of these runs beside those of earlier calls."""
    name = f"nes_{study.task}"
    try:
        found = read_result(name)["variants"]
    except NotMeasured:
        found = {}
    for variant in variants:
        rows = [row for seed in seeds if (row := study.row(variant, seed)) is not None]
        if rows:
            found[variant] = {
                "machine": machine(),
                "commands": commands(study, variant, rows),
                "options": VARIANTS[variant],
                "hyperparameters": study.hyperparameters(variant, rows[0]["seed"]),
                "runs": rows,
            }
    ordered = {variant: found[variant] for variant in VARIANTS if variant in found}
    return write_result(name, "python -m benchmarks.nes.study", {"variants": ordered})


def main() -> None:
    """Run what is missing, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS))
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--transfers", type=int, default=20, help="agents on each best SE")
    parser.add_argument("--agents", nargs="+", choices=AGENTS, default=["ddqn"])
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at a time")
    parser.add_argument("--home", type=Path, required=True)
    options = parser.parse_args()
    study = Study(options.task, options.generations, options.home)
    seeds = sorted(set(options.seeds))
    with ThreadPoolExecutor(options.jobs) as jobs:
        runs = [
            jobs.submit(study.run, variant, seed, options.transfers, options.agents)
            for variant in options.variants
            for seed in seeds
        ]
    for run in runs:
        run.result()
    print(f"written to {write(study, options.variants, seeds)}")


if __name__ == "__main__":
    main()
