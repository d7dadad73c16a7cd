"""Evaluations whose agents differ: varied agents on a recorded run's SEs, and agents of
random BOHB configurations on untrained SEs.

    python -m benchmarks.scaling.agents CartPole-v0 --seed 0 --generations 1 23 --home FOLDER

FOLDER is where `benchmarks.scaling.nes_runs` recorded that run.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.machine import write_result
from benchmarks.scaling.evaluations import Processes, columns, processes
from benchmarks.scaling.nes_runs import generation_path
from bilevel.evaluation import EvaluationRequest
from bilevel.hyperparameters import AgentHyperparameters, DDQNHyperparameters, load_preset
from bilevel.nes import NES, NESState
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task, get_task
from cluster.profiles import base_hyperparameters, get_profile
from search_spaces import draw_agent, search_space, to_hyperparameters

#: Evaluations of each configuration.
REPEATS = 3


def size_of(agent: AgentHyperparameters) -> list[int]:
    """Hidden layers, hidden size and batch size: what an agent's step costs."""
    assert isinstance(agent, DDQNHyperparameters)
    return [agent.hidden_layers, agent.hidden_size, agent.batch_size]


def varied(
    workers: Processes, task: Task, seed: int, home: Path, generation: int
) -> dict[str, Any]:
    """One generation with varied agents, on the SE that a run without had."""
    hp = replace(load_preset("tuned", task.id, "antithetic"), vary_agent="all")
    nes = NES(task, hp, seed, draw_agent)
    state = NESState.load(generation_path(home, task.id, seed, generation))
    requests = nes.ask(state)
    results = workers.run(task, nes.architecture, state.psi, requests)
    members = requests[: hp.nes.population_size]
    return {
        "generation": generation,
        "agents": [size_of(request.agent) for request in members],
        **columns(task, results),
    }


def of_configurations(workers: Processes, task: Task, count: int) -> list[dict[str, Any]]:
    """Evaluations of `count` (none, or several) random configurations of the paper's space."""
    base = base_hyperparameters(get_profile("paper"), task)
    rows = []
    for sample in search_space("full", seed=0).sample_configuration(count) if count > 1 else []:
        hp = to_hyperparameters(base, dict(sample))
        requests = [EvaluationRequest(i, i, hp.agents[0], start_seed=i) for i in range(REPEATS)]
        results = workers.run(task, Architecture.of(task, hp.se), None, requests)
        rows.append(
            {
                "evaluations_a_generation": hp.nes.evaluations,
                "agent": size_of(hp.agents[0]),
                **columns(task, results),
            }
        )
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Write `results/scaling_agents_TASK.json`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("task")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--generations", type=int, nargs="+", required=True)
    parser.add_argument("--configurations", type=int, default=32)
    parser.add_argument("--home", type=Path, required=True)
    args = parser.parse_args()
    task = get_task(args.task)
    with processes() as workers:
        configurations = of_configurations(workers, task, args.configurations)
        generations = [varied(workers, task, args.seed, args.home, g) for g in args.generations]
    path = write_result(
        f"scaling_agents_{task.id}",
        f"python -m benchmarks.scaling.agents {task.id} --seed {args.seed} "
        f"--generations {' '.join(map(str, args.generations))} "
        f"--configurations {args.configurations} --home FOLDER",
        {
            "task": task.id,
            "seed": args.seed,
            "configurations": configurations,
            "varied": generations,
        },
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
