"""Real studies: what Ray Tune, MLflow and the journal cost a search's driver, and how long
a search takes that the simulation then repeats.

    python -m benchmarks.scaling.study --home FOLDER
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import write_result
from bilevel.tasks import get_task
from cluster.bohb.brackets import Schedule
from cluster.bohb.command import StudyCommand, run_study
from cluster.bohb.journal import Journal, ResultLine
from cluster.bohb.study import Study
from cluster.home import Home
from cluster.place import Place
from cluster.profiles import Profile, base_hyperparameters

LADDER = (1, 9)
#: Evaluations of one short episode each: what is left is the driver's.
TRIVIAL = Profile("core", 1, *LADDER, None, 1, "random", 1, 6, None, final_agents=1)
REAL = Profile("core", 4, *LADDER, None, 1000, "random", 1, 3, None, final_agents=1)


def run(home: Path, name: str, profile: Profile, trials: int) -> dict[str, Any]:
    """One study; its jobs in the order of their ends, with the seconds of the generations
    that each had left to run."""
    task, place = get_task("CartPole-v0"), Place(Home(home), Home(home).database_uri)
    folder, base = place.home.run_folder(task.id, name), base_hyperparameters(profile, task)
    study = Study(folder, task, 0, profile.space, Schedule(LADDER, len(LADDER)), base)
    command = StudyCommand(
        study,
        place,
        profile.brackets,
        profile.time_budget,
        profile.final_agents,
        concurrent_trials=trials,
    )
    assert run_study(command) == 0
    journal = Journal(folder)
    configurations = {line.id: line.configuration for line in journal.configs}
    reached: dict[tuple[int, int, int], int] = {}
    jobs = []
    first = min(line.timestamps["submitted"] for line in journal.results)
    for line in journal.results:
        state = study.run(line.id, configurations[line.id]).load()
        assert state is not None
        records = state.records[reached.get(line.id, 0) : line.budget]
        reached[line.id] = line.budget
        jobs.append(_row(line, first, [record.generation_seconds for record in records]))
    return {"name": name, "trials": trials, "jobs": jobs}


def _row(line: ResultLine, first: float, seconds: list[float]) -> dict[str, Any]:
    return {
        "id": list(line.id),
        "budget": line.budget,
        "loss": line.loss,
        "submitted": round(line.timestamps["submitted"] - first, 3),
        "finished": round(line.timestamps["finished"] - first, 3),
        "generation_seconds": [round(value, 4) for value in seconds],
    }


def driver_overhead(study: dict[str, Any]) -> dict[str, float]:
    """Seconds per job and per generation reported, of a study with one trial at a time:
    least squares of what lies between a job's start and the next one's, less the
    generations themselves. All of it is taken for the driver's own, which is too much."""
    jobs = sorted(study["jobs"], key=lambda job: float(job["submitted"]))
    starts = np.array([job["submitted"] for job in jobs])
    inside = np.array([sum(job["generation_seconds"]) for job in jobs[:-1]])
    reports = np.array([len(job["generation_seconds"]) for job in jobs[:-1]])
    left = np.diff(starts) - inside
    # The first job also waits for the processes of the trial and of its pool.
    terms = np.stack([np.ones_like(reports), reports], axis=1)[1:]
    per_job, per_report = np.linalg.lstsq(terms, left[1:], rcond=None)[0]
    return {
        "start_seconds": round(float(left[0] - per_job - per_report * reports[0]), 3),
        "job_seconds": round(float(per_job), 4),
        "report_seconds": round(float(per_report), 4),
    }


def main() -> None:
    """Run both studies, write `results/scaling_study.json`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--home", type=Path, required=True)
    home: Path = parser.parse_args().home
    trivial = run(home, "trivial", TRIVIAL, trials=1)
    real = run(home, "real", REAL, trials=2)
    path = write_result(
        "scaling_study",
        "python -m benchmarks.scaling.study --home FOLDER",
        {"driver_overhead": driver_overhead(trivial), "studies": [trivial, real]},
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
