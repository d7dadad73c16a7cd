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


def inner_loop(bound: bool = True) -> str:
    """Times of kernel and definition, and if asked of the arithmetic bound."""
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
    head = ["agent", "compiled", "torch definition", "times as fast", "bound", "times the bound"]
    columns = len(head) if bound else 4
    return _table(head[:columns], [row[:columns] for row in rows], result)


def products() -> str:
    """Times of matrix products by tiles and by BLAS."""
    result = read_result("products")
    rows = [
        [
            product,
            f"{case['tiles_us']['median']:.1f} µs",
            f"{case['blas_us']['median']:.1f} µs",
            _spread(case["ratio"], ".1f"),
        ]
        for product, case in result["results"].items()
    ]
    return _table(["product", "tiles", "BLAS", "times as fast"], rows, result)


def startup() -> str:
    """Times of the parts of the start."""
    result = read_result("startup")
    rows = [
        [home, *(_spread(parts[name], ".1f") for name in (*result["parts"], "all"))]
        for home, parts in result["seconds"].items()
    ]
    return _table(["seconds", *result["parts"], "all"], rows, result)


def small_things() -> str:
    """Times of loading and testing, and memory of an actor."""
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


def vector_env() -> str:
    """Steps per second of many copies of an SE."""
    result = read_result("vector_env")
    rows = [
        [
            copies,
            f"{rates['batched']['median']:,.0f}".replace(",", " "),
            f"{rates['looped']['median']:,.0f}".replace(",", " "),
            _spread(rates["ratio"], ".1f"),
        ]
        for copies, rates in result["rates"].items()
    ]
    head = ["copies", "steps per second together", "in gymnasium's loop", "times as fast"]
    return _table(head, rows, result)


def cost() -> str:
    """Measured over estimated time of evaluations."""
    result = read_result("cost")
    rows = [
        [agents, f"{case['ms_an_agent']:.1f}", _spread(case["measured_over_estimated"], ".2f")]
        for agents, case in result["results"].items()
    ]
    return _table(
        ["agents", "milliseconds per agent", "measured time over core seconds"], rows, result
    )


TABLES: dict[str, Callable[[], str]] = {
    "inner-loop": inner_loop,
    "products": products,
    "startup": startup,
    "small-things": small_things,
    "vector-env": vector_env,
    "cost": cost,
}
