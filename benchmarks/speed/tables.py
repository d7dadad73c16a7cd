"""The tables of docs/speed.md, from the committed results."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from benchmarks.machine import read_result
from benchmarks.markdown import source, table


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], result: dict[str, Any]) -> str:
    return f"{table(head, rows)}\n\n{source(result)}"


def _spread(value: dict[str, float], form: str) -> str:
    median, low, high = (format(value[key], form) for key in ("median", "low", "high"))
    return f"{median} ({low} to {high})"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def inner_loop() -> str:
    """Kernel, definition and arithmetic bound."""
    result = read_result("inner_loop", "core")
    rows = [
        [
            name,
            f"{case['kernel_us']['median']:.0f} µs",
            f"{case['torch_us']['median']:.0f} µs",
            _spread(case["ratio"], ".1f"),
            f"{case['bound_us']:.0f} µs",
            _spread(case["over_bound"], ".1f"),
        ]
        for name, case in result["results"].items()
    ]
    head = ["agent", "compiled", "torch", "times as fast", "bound", "times the bound"]
    return _table(head, rows, result)


def generation() -> str:
    """Parts of a generation's time."""
    result = read_result("generation")
    rows = []
    for task, case in result["results"].items():
        numbers = ", ".join(map(str, case["generations"]))
        for actors, shares in case["shares"].items():
            seconds = _spread(case["seconds"][actors], ".2f")
            rows.append([f"{task}, {numbers}", actors, seconds, *map(_percent, shares.values())])
        whole = case["whole_run"]
        rows.append(
            [
                f"{task}, 0 to {whole['generations'] - 1}",
                str(whole["actors"]),
                "",
                *map(_percent, whole["shares"].values()),
            ]
        )
    parts = ("kernels", "waiting", "Ray", "Python", "MLflow")
    return _table(["generations", "actors", "seconds", *parts], rows, result)


def two_actors() -> str:
    """Speed-up of the second actor."""
    result = read_result("generation")
    rows = []
    for task, case in result["results"].items():
        kernels = {
            actors: int(actors) * case["seconds"][actors]["median"] * shares["kernels"]
            for actors, shares in case["shares"].items()
        }
        rows.append(
            [
                task,
                _spread(case["two_actors_over_one"], ".2f"),
                f"{kernels['2'] / kernels['1']:.2f}",
                _percent(_overhead(case, "1")),
            ]
        )
    head = ["task", "two actors, times as fast as one", "kernel time, times that of one"]
    return _table([*head, "Ray, Python and MLflow, one actor"], rows, result)


def _overhead(case: dict[str, Any], actors: str) -> float:
    return float(sum(case["shares"][actors][part] for part in ("ray", "python", "mlflow")))


def handing_out() -> str:
    """Early against on demand."""
    result = read_result("handing_out")
    rows = [
        [name, f"{_spread(value, '.2f')} ms"] for name, value in result["beyond_kernel_ms"].items()
    ]
    return _table(["the next request comes", "an evaluation beyond its kernel"], rows, result)


def startup() -> str:
    """Parts of the start."""
    result = read_result("startup")
    rows = [
        [home, *(_spread(parts[name], ".1f") for name in (*result["parts"], "all"))]
        for home, parts in result["seconds"].items()
    ]
    return _table(["seconds", *result["parts"], "all"], rows, result)


def small_things() -> str:
    """Loading, testing, memory."""
    result = read_result("startup")
    rows = [["load an SE file", f"{result['se_load_ms']:.2f} ms"]]
    rows += [
        [f"10 test episodes on {task}, at most", f"{milliseconds:.1f} ms"]
        for task, milliseconds in result["real_task_ms"].items()
    ]
    rows += [
        [f"peak memory of an actor, {agent}", f"{mebibytes:.0f} MiB"]
        for agent, mebibytes in result["actor_peak_mib"].items()
    ]
    return _table(["", ""], rows, result)


def utilisation() -> str:
    """Of a search."""
    result = read_result("utilisation")
    row = [
        f"{result['minutes']:.1f}",
        str(result["results"]),
        str(result["generations"]),
        _percent(result["core_utilisation"]),
    ]
    return _table(["minutes", "results", "generations", "core utilisation"], [row], result)


def ideas() -> str:
    """What is there against what might be."""
    result = read_result("ideas")
    rows = [
        [
            name,
            agent,
            _spread(case["as_it_is_us"], ".2f"),
            _spread(case["idea_us"], ".2f"),
            _spread(case["times_as_fast"], ".2f"),
        ]
        for agent, cases in result["results"].items()
        for name, case in cases.items()
    ]
    return _table(["idea", "agent", "as it is, µs", "the idea, µs", "times as fast"], rows, result)


TABLES: dict[str, Callable[[], str]] = {
    "inner-loop": inner_loop,
    "generation": generation,
    "two-actors": two_actors,
    "handing-out": handing_out,
    "startup": startup,
    "small-things": small_things,
    "utilisation": utilisation,
    "ideas": ideas,
}
