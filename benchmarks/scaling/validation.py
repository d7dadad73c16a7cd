"""The simulations against what was measured: the real pool, a real study."""

from typing import Any

import numpy as np

from benchmarks.scaling.recorded import load, pool_overhead, study_overhead
from benchmarks.scaling.searches import simulated
from benchmarks.scaling.simulation import JobCourse, SearchTimeline, simulate_pool
from benchmarks.scaling.study import REAL
from cluster.bohb.search import Job


def of_the_pool() -> list[dict[str, float]]:
    """Measured and simulated seconds of the same requests, each from the evaluations' own
    seconds of that measurement; and what the seconds measured with one actor forecast."""
    replays, overhead = load("pool")["replays"], pool_overhead()
    alone = {row["generation"]: row["seconds"] for row in replays if row["actors"] == 1}
    rows = []
    for row in replays:
        line = simulate_pool(row["seconds"], row["actors"], overhead)
        forecast = simulate_pool(alone[row["generation"]], row["actors"], overhead)
        rows.append(
            {
                "generation": row["generation"],
                "actors": row["actors"],
                "evaluations": line.evaluations,
                "measured_seconds": row["wall_seconds"],
                "simulated_seconds": round(line.seconds, 3),
                "forecast_seconds": round(forecast.seconds, 3),
            }
        )
    return rows


def replayed_study() -> tuple[SearchTimeline, dict[str, Any]]:
    """The real study simulated with its own generations' seconds; what was measured."""
    study = next(s for s in load("study")["studies"] if s["name"] == "real")
    measured = {(tuple(job["id"]), job["budget"]): job for job in study["jobs"]}

    def course(job: Job) -> JobCourse:
        row = measured[job.id, job.budget]
        seconds = row["generation_seconds"]
        return JobCourse(seconds, seconds, row["loss"])

    line = simulated(REAL, study["trials"], study["trials"], course, study_overhead())
    return line, study


def of_the_study() -> dict[str, float]:
    """Measured and simulated seconds of a real study, and whether it was the same jobs."""
    line, study = replayed_study()
    jobs = study["jobs"]
    return {
        "trials": study["trials"],
        "jobs": len(jobs),
        "measured_seconds": max(job["finished"] for job in jobs),
        "simulated_seconds": round(line.seconds, 3),
        "generations": int(np.sum([len(job["generation_seconds"]) for job in jobs])),
    }
