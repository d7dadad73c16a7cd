"""Tables of NES over seeds, from the committed results."""

import statistics
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from benchmarks.machine import NotMeasured, read_result
from benchmarks.markdown import table
from benchmarks.nes.study import AGENTS
from bilevel.tasks import get_task

TASKS = ("CartPole-v0", "Acrobot-v1")

_HEADER = (
    "variant",
    "solved",
    "first solved generation",
    "solved from then on",
    "generations",
    "minutes",
    "varied DDQN on the best SE",
    "of them at least {solved}",
    "their steps",
)


def _spread(values: Sequence[float], form: str) -> str:
    if not values:
        return "-"
    low, middle, high = min(values), statistics.median(values), max(values)
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"


def variant_row(name: str, runs: Sequence[dict[str, Any]], solved_reward: float) -> list[str]:
    """One variant: medians over its seeds, with the lowest and the highest."""

    def column(field: str) -> list[float]:
        return [run[field] for run in runs if run[field] is not None]

    on_ddqn = [run["varied"]["ddqn"] for run in runs if "ddqn" in run["varied"]]

    solved = sum(run["final_score_mean"] >= solved_reward for run in runs)
    varied = [agents["score_mean"] for agents in on_ddqn]
    reached = sum(score >= solved_reward for score in varied)
    return [
        name,
        f"{solved} of {len(runs)}",
        _spread(column("first_solved_generation"), ".0f"),
        f"{statistics.mean(column('solved_since') or [0]):.0%}",
        _spread(column("generations"), ".0f"),
        _spread(column("minutes"), ".1f"),
        _spread(varied, ".1f"),
        f"{reached} of {len(varied)}" if varied else "-",
        _spread([agents["train_steps_mean"] for agents in on_ddqn], ".0f"),
    ]


def seeds(task: str) -> str:
    """All variants on a task."""
    result = read_result(f"nes_{task}")
    solved_reward = get_task(task).solved_reward
    header = [cell.format(solved=f"{solved_reward:g}") for cell in _HEADER]
    rows = [
        variant_row(name, variant["runs"], solved_reward)
        for name, variant in result["variants"].items()
    ]
    return f"{table(header, rows)}\n\n(one core a run;\n{_sources(result['variants'].values())})"


def _sources(measured: Iterable[dict[str, Any]]) -> str:
    """Machines, and what was called on each."""
    calls: dict[str, dict[str, None]] = {}  # without doubles
    for one in measured:
        calls.setdefault(_machine(one), {}).update(dict.fromkeys(one["commands"]))
    return ";\n".join(
        "\n".join([f"{machine}:", *(f"`{command}`" for command in commands)])
        for machine, commands in calls.items()
    )


def transfer() -> str:
    """Every kind of agents on the best SE of each run that they were tried on."""
    head = ["task", "learned with", "agents", "SEs", "test return", "solve", "train steps"]
    rows: list[list[str]] = []
    for task in TASKS:
        for name, variant in read_result(f"nes_{task}", "variants")["variants"].items():
            for agent in AGENTS:
                found = [run["varied"][agent] for run in variant["runs"] if agent in run["varied"]]
                if found:
                    rows.append(
                        [
                            task,
                            name,
                            f"{found[0]['agents']} {agent}",
                            str(len(found)),
                            _spread([one["score_mean"] for one in found], ".1f"),
                            f"{statistics.mean(one['solved_fraction'] for one in found):.0%}",
                            _spread([one["train_steps_mean"] for one in found], ".0f"),
                        ]
                    )
    if not rows:
        raise NotMeasured("other agents on the best SEs")
    return table(head, rows)


def step_limits(task: str) -> str:
    """Small varied agents on the same SEs, their episodes ever longer."""
    result = read_result(f"step_limits_{task}")
    head, rows = ["step limit"], []
    for agent in result["points"]:
        head += [agent, "train steps"]
    for points in zip(*result["points"].values(), strict=True):
        row = [f"{points[0]['share']:.0%}"]
        for point in points:
            row.append(_spread([se["score_mean"] for se in point["ses"]], ".1f"))
            row.append(f"{statistics.median(se['train_steps_mean'] for se in point['ses']):.0f}")
        rows.append(row)
    return table(head, rows) + (
        f"\n\n({len(points[0]['ses'])} SEs, {result['agents']} agents of each kind on each; the "
        f"median SE, the lowest and the highest; {_machine(result)}; `{result['command']}`)"
    )


def update_rules(task: str) -> str:
    """Every rule that was tried from random starts; a star where on another machine than most."""
    result = read_result(f"update_rules_{task}")
    solved_reward, rows, measured = get_task(task).solved_reward, [], []
    machines = [_machine(rule) for rule in result["rules"].values()]
    usual = statistics.mode(machines)
    for (name, rule), machine in zip(result["rules"].items(), machines, strict=True):
        runs = rule["runs"]
        best = [run["best"]["score_mean"] for run in runs]
        first = [run["first_solved_generation"] for run in runs]
        found = [generation for generation in first if generation is not None]
        minutes = _spread([run["minutes"] for run in runs], ".1f")
        rows.append(
            [
                name,
                f"{len(found)} of {len(runs)}",
                _spread(found, ".0f"),
                f"{sum(run['solved_at_the_end'] for run in runs)} of {len(runs)}",
                _spread([run["score_curve"][-1] for run in runs], ".1f"),
                minutes if machine == usual else f"{minutes} *",
                _spread(best, ".1f"),
                f"{sum(score >= solved_reward for score in best)} of {len(runs)}",
                _spread([run["best"]["train_steps_mean"] for run in runs], ".0f"),
            ]
        )
        measured.append({**rule, "commands": [rule["command"].replace(f"'{name}'", "RULE")]})
    head = [
        "rule",
        "solved at some generation",
        "the first of them",
        "solved at the last",
        "score at the last",
        "minutes",
        "fresh agents on the best SE",
        f"of them at least {solved_reward:g}",
        "their steps",
    ]
    measured.sort(key=lambda rule: _machine(rule) != usual)
    sources = _sources(measured).replace(";\n", ";\n\\* ")
    return f"{table(head, rows)}\n\n({sources})"


def variation() -> str:
    """What agents that vary cost, as a multiple of what fixed ones do."""
    head, rows, measured = ["task", "agents", "time of an evaluation", "train steps"], [], []
    for task in TASKS:
        result = read_result(f"variation_{task}")
        for way, cost in result["ways"].items():
            cells = [
                f"{found['median']:.2f} ({found['low']:.2f} to {found['high']:.2f})"
                for found in (cost["seconds"], cost["train_steps"])
            ]
            rows.append([task, way, *cells])
        measured.append({**result, "commands": [result["command"]]})
    about = (
        f"Multiples of fixed agents'; {result['ses']} SEs, {result['agents']} agents on each, "
        f"{result['repeats']} times; the median time, the lowest and the highest."
    )
    return f"{table(head, rows)}\n\n{about}\n({_sources(measured)})"


def _machine(result: dict[str, Any]) -> str:
    return f"{result['machine']['cores']} cores of {result['machine']['processor']}"


def defaults() -> str:
    """The defaults alone, a row a task."""
    header = [cell.format(solved="solved") for cell in ("task", *_HEADER[1:])]
    rows, measured = [], []
    for task in TASKS:
        result = read_result(f"nes_{task}", "variants")
        variant = result["variants"]["defaults"]
        rows.append(variant_row(task, variant["runs"], get_task(task).solved_reward))
        measured.append({**variant, "commands": variant["commands"][:1]})
    return f"{table(header, rows)}\n\n(one core a run;\n{_sources(measured)})"


TABLES: dict[str, Callable[[], str]] = {
    **{f"nes-{task}": partial(seeds, task) for task in TASKS},
    "nes-transfer": transfer,
    "variation": variation,
    **{f"update-rules-{task}": partial(update_rules, task) for task in TASKS},
    **{f"step-limits-{task}": partial(step_limits, task) for task in TASKS},
}
