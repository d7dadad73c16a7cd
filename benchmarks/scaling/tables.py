"""The tables of docs/scaling.md, from the committed results."""

from collections.abc import Callable
from typing import Any

from benchmarks.markdown import source, table
from benchmarks.scaling.generations import CORES, GENERATION, MEMBERS
from benchmarks.scaling.recorded import PHASE, TASKS, load

#: A split that is at most this much slower than the fastest one is as good.
AS_GOOD = 1.1


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.095 or share == 0 else f"{100 * share:.1f} %"


def _seconds(value: float) -> str:
    return f"{value:.3g} s"


def _simulated() -> dict[str, Any]:
    return load("simulated")


def _of_cases(part: str) -> list[tuple[str, Any]]:
    """What the scenarios say of each task's cases, by name."""
    found = _simulated()["generations"]
    return [
        (f"{task}, {case}", value) for task in TASKS for case, value in found[task][part].items()
    ]


def recommended() -> str:
    """Settings by cluster."""
    result = _simulated()
    populations = result["generations"][TASKS[0]]["larger_population"]["fixed agents, early"]
    rows = []
    for row in populations:
        cores = row["cores"]
        population = row["at_equal_time"] if cores > GENERATION else MEMBERS
        best = recommended_split(cores)
        workers, trials = best["workers_per_trial"], best["trials"]
        rows.append(
            (
                cores,
                f"`--workers {min(cores, 3 * population)} --population {population}`",
                f"`--workers-per-trial {workers} --concurrent-trials {trials}`",
                f"{60 * best['hours']:.0f} min",
                _percent(best["efficiency"]),
                _percent(best["model_based"]),
            )
        )
    head = ["cores", "`bilevel nes`", "`bilevel bohb --profile paper`", "search takes"]
    whole = table([*head, "efficiency", "configurations by the model"], rows)
    return (
        f"{whole}\n\nThe population is the paper's {MEMBERS}, on more than {GENERATION} cores the "
        "largest one whose generation takes at\nmost a tenth longer. The split is the one with the "
        "fewest trials at a time among those at most a\ntenth slower than the fastest: fewer at a "
        "time leave BOHB's model more results to learn from."
    )


def recommended_split(cores: int) -> dict[str, Any]:
    """The row of that cluster's best split."""
    rows = [row for row in _simulated()["search"]["splits"] if row["cores"] == cores]
    fastest = min(row["hours"] for row in rows)
    good = [row for row in rows if row["hours"] <= AS_GOOD * fastest]
    best: dict[str, Any] = min(good, key=lambda row: row["trials"])
    return best


def spread() -> str:
    """The measured distributions."""
    rows = [
        (
            name,
            case["evaluations"],
            f"{case['mean_train_steps']:.0f}",
            _seconds(case["mean_seconds"]),
            _seconds(case["median_seconds"]),
            f"{case['coefficient_of_variation']:.2f}",
            f"{case['longest_to_mean']:.1f}",
        )
        for name, case in _of_cases("spread")
    ]
    head = ["evaluations of", "measured", "train steps", "mean", "median", "deviation / mean"]
    results = [load(f"{kind}_{task}") for task in TASKS for kind in ("nes", "agents")]
    return table([*head, "longest of a generation / mean"], rows) + "\n\n" + source(*results)


def validation() -> str:
    """Simulated against measured."""
    result = _simulated()["validation"]
    rows = []
    for row in result["pool"]:
        what = f"generation {row['generation']}, {row['actors']} actor(s)"
        simulated = _compared(row["measured_seconds"], row["simulated_seconds"])
        forecast = _compared(row["measured_seconds"], row["forecast_seconds"])
        rows.append((what, f"{row['measured_seconds']:.2f} s", simulated, forecast))
    study = result["study"]
    measured = study["measured_seconds"]
    what = f"search: {study['jobs']} jobs, {study['generations']} generations, "
    what += f"{study['trials']} trials at a time"
    simulated = _compared(measured, study["simulated_seconds"])
    rows.append((what, f"{measured:.1f} s", simulated, "-"))
    head = ["", "measured", "simulated from its own seconds", "from those with one actor"]
    return table(head, rows) + "\n\n" + source(load("pool"), load("study"))


def _compared(measured: float, simulated: float) -> str:
    return f"{simulated:.2f} s ({100 * (simulated / measured - 1):+.1f} %)"


def by_cores() -> str:
    """One generation of 16 members: seconds, efficiency, waiting."""
    cases = _of_cases("by_cores")
    chosen = (16, 32, 48, 64, 256, 1024)
    rows = []
    for name, case in cases:
        at = {row["cores"]: row for row in case}
        cells = [f"{at[c]['seconds']:.2f} s, {_percent(at[c]['efficiency'])}" for c in chosen]
        rows.append((name, *cells))
    return table(["one generation, its efficiency", *(f"{c} cores" for c in chosen)], rows)


def waiting() -> str:
    """The straggler's share."""
    chosen = (2, 8, 16, 24, 32, 48)
    rows = []
    for name, case in _of_cases("by_cores"):
        at = {row["cores"]: row for row in case}
        rows.append((name, *(_percent(at[c]["straggler_share"]) for c in chosen)))
    return table(["waiting for the slowest", *(f"{c} cores" for c in chosen)], rows)


def stages() -> str:
    """What may run at the same time."""
    result = _simulated()["generations"]
    rows = []
    for task in TASKS:
        for row in result[task]["stages"]:
            shares = [_percent(row["efficiency"][str(c)]) for c in CORES]
            rows.append((f"{task}, {row['stage']}", row["independent"], *shares))
    head = ["stage", "independent evaluations"]
    return table([*head, *(f"{c} cores" for c in CORES)], rows)


def ordering() -> str:
    """What other orders of the requests gain."""
    result = _simulated()["generations"]
    rows = []
    for task in TASKS:
        for agents, orders in result[task]["ordering"].items():
            for row in orders:
                saved = [f"{100 * share:+.0f} %" for share in row["saved"].values()]
                rows.append((f"{task}, {agents}", row["order"], *saved))
    cores = [f"{c} cores" for c in result[TASKS[0]]["ordering"]["fixed agents"][0]["saved"]]
    return table(["generations of", "longest expected first, by", *cores], rows)


def asynchronous() -> str:
    """The bound of an NES that never waits, and how stale it would be on more cores."""
    cases = _of_cases("asynchronous")
    rows = [(name, *(f"{row['gain']:.1f}" for row in case)) for name, case in cases]
    head = [f"{row['cores']} cores" for row in cases[0][1]]
    stale = ", ".join(f"{c / GENERATION:.0f} on {c} cores" for c in CORES if c > 2 * GENERATION)
    return (
        table(["times as many generations", *head], rows)
        + "\n\nIf more cores than that were kept busy, the updates made while an evaluation runs "
        + f"would\nbe {stale}."
    )


def larger_population() -> str:
    """Populations on the cores that 16 members leave idle."""
    rows = []
    for name, case in _of_cases("larger_population"):
        for row in case[1:]:
            rows.append(
                (
                    name,
                    row["cores"],
                    row["at_equal_time"],
                    row["filling"],
                    f"{row['filling_seconds']:.2f}",
                    f"{row['filling_throughput']:.1f}",
                )
            )
    head = ["evaluations of", "cores", "population in 1.1 times the time", "population that fills"]
    return table([*head, "takes times as long", "evaluations a second, times"], rows)


def splits() -> str:
    """A search, by trials at a time and workers each."""
    rows = [
        (
            row["cores"],
            f"{row['trials']} x {row['workers_per_trial']}",
            f"{row['hours']:.2f}",
            _percent(row["efficiency"]),
            _percent(row["model_based"]),
            _percent(row["driver_share"]),
        )
        for row in _simulated()["search"]["splits"]
    ]
    head = ["cores", "trials x workers", "hours", "efficiency", "configurations by the model"]
    return table([*head, "driver busy"], rows) + "\n\n" + source(_simulated())


def longer() -> str:
    """More brackets on the largest cluster."""
    search = _simulated()["search"]
    first = search["longer"][0]
    same = ("cores", "workers_per_trial")
    base = next(r for r in search["splits"] if all(r[name] == first[name] for name in same))
    rows = [
        (
            row["brackets"],
            f"{row['hours']:.2f}",
            f"{row['brackets'] / row['hours']:.0f}",
            _percent(row["efficiency"]),
            _percent(row["model_based"]),
        )
        for row in (base, *search["longer"])
    ]
    head = ["brackets", "hours", "brackets an hour", "efficiency", "configurations by the model"]
    what = f"{first['cores']} cores, {first['trials']} x {first['workers_per_trial']}"
    return table([f"{what}: {head[0]}", *head[1:]], rows)


def overheads() -> str:
    """Ray's cost per evaluation, the search driver's per generation."""
    pool, study = load("pool"), load("study")["driver_overhead"]
    rows = [
        (
            row["actors"],
            f"{row['actor_ms']:.2f} ms",
            f"{row['evaluation_ms']:.2f} ms",
            f"{row['actor_ms'] - row['evaluation_ms']:.2f} ms",
            f"{row['driver_ms']:.2f} ms",
        )
        for row in pool["overhead"]
    ]
    head = ["actors", "an actor's time per evaluation", "in the evaluation", "overhead"]
    whole = table([*head, "processor time of the driver"], rows)
    out = ", ".join(
        f"{row['driver_ms']:.2f} ms with {row['references']}"
        for row in pool["driver_by_references"]
    )
    driver = pool["overhead"][0]["driver_ms"] / 1e3
    lines = [
        f"The driver's processor time by evaluations in flight: {out}.\n",
        f"At {1e3 * driver:.2f} ms an evaluation one driver sends at most {1 / driver:.0f} "
        f"a second:\nit keeps {GENERATION} cores busy with evaluations of "
        f"{GENERATION * driver:.3f} s or more, 256 with {256 * driver:.2f} s, 1024 with "
        f"{1024 * driver:.2f} s.\n",
        f"The driver of a search spends {1e3 * study['report_seconds']:.0f} ms on each "
        f"generation that is reported and {1e3 * study['job_seconds']:.0f} ms on each job (Tune, "
        "journal, MLflow's database, pictures): at most "
        f"{1 / study['report_seconds']:.0f} generations a second.",
    ]
    return whole + "\n\n" + "\n".join(lines)


def _phase() -> str:
    return f"Early and late are the first and the last {PHASE} generations of a run."


TABLES: dict[str, Callable[[], str]] = {
    "recommended": recommended,
    "spread": spread,
    "phase": _phase,
    "validation": validation,
    "overheads": overheads,
    "by-cores": by_cores,
    "waiting": waiting,
    "stages": stages,
    "ordering": ordering,
    "asynchronous": asynchronous,
    "larger-population": larger_population,
    "splits": splits,
    "longer": longer,
}
