"""The real pool: what an evaluation costs beside its own seconds, and how long the same
generation takes with 1 and with 2 actors.

    python -m benchmarks.scaling.pool CartPole-v0 --seed 0 --generations 1 23 --home FOLDER

FOLDER is where `benchmarks.scaling.nes_runs` recorded that run.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import ray

from benchmarks.machine import write_result
from benchmarks.scaling.evaluations import columns
from benchmarks.scaling.nes_runs import generation_path
from bilevel.evaluation import EvaluationRequest, EvaluationResult
from bilevel.hyperparameters import DDQNHyperparameters, load_preset
from bilevel.nes import NES, NESState
from bilevel.synthetic_env import Architecture
from bilevel.tasks import get_task
from cluster.pool import EvaluationPool
from cluster.ray_cluster import ray_cluster

#: Evaluations of one measurement of the overhead, and of one actor's queue.
TRIVIAL, QUEUED = 1000, (1, 16, 64, 256, 1024)
ACTORS = (1, 2)


def trivial_requests(count: int) -> list[EvaluationRequest]:
    """Evaluations next to nothing long: one episode, a network of one unit."""
    (tuned,) = load_preset("tuned", "CartPole-v0").agents
    assert isinstance(tuned, DDQNHyperparameters)
    agent = replace(
        tuned, max_episodes=1, test_episodes=1, hidden_size=1, batch_size=1, init_episodes=10
    )
    return [EvaluationRequest(i, i, agent, start_seed=i) for i in range(count)]


def overhead(pool: EvaluationPool) -> dict[str, float]:
    """Milliseconds per evaluation: of the actor, of the evaluation itself, of the driver
    (its processor time, Ray's threads in it included)."""
    task = get_task("CartPole-v0")
    shape = Architecture(task.state_size, task.n_actions, 1, 8, "tanh")
    requests = trivial_requests(TRIVIAL)
    pool.run(task, shape, None, requests[:100])
    wall, processor = time.perf_counter(), time.process_time()
    results = pool.run(task, shape, None, requests)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    return {
        "actors": pool.size,
        "actor_ms": round(wall * pool.size / TRIVIAL * 1e3, 4),
        "evaluation_ms": round(sum(r.seconds for r in results) / TRIVIAL * 1e3, 4),
        "driver_ms": round(processor / TRIVIAL * 1e3, 4),
    }


@ray.remote(num_cpus=1)
class _Echo:
    """Answers at once."""

    def echo(self, value: int) -> int:
        return value


def driver_by_references(references: int) -> dict[str, float]:
    """Milliseconds of the driver's processor time per answer while so many are out.

    The driver waits as the pool does, for any of all references; the answers come from
    one actor's queue, as this machine has no cores for more of them."""
    actor = _Echo.remote()  # type: ignore[attr-defined]
    ray.get(actor.echo.remote(0))
    running = [actor.echo.remote(i) for i in range(references)]
    count = 2 * max(QUEUED)
    started = time.process_time()
    for i in range(count):
        done, running = ray.wait(running, num_returns=1)
        ray.get(done[0])
        running.append(actor.echo.remote(i))
    seconds = time.process_time() - started
    ray.kill(actor)
    return {"references": references, "driver_ms": round(seconds / count * 1e3, 4)}


def replayed(
    pool: EvaluationPool, nes: NES, home: Path, generations: Sequence[int]
) -> list[dict[str, Any]]:
    """The pool's seconds for generations that were recorded before."""
    rows = []
    for generation in generations:
        state = NESState.load(generation_path(home, nes.task.id, nes.seed, generation))
        requests = nes.ask(state)
        results: list[EvaluationResult] = []
        pool.run(nes.task, nes.architecture, state.psi, requests[: pool.size])
        started = time.perf_counter()
        pool.run(nes.task, nes.architecture, state.psi, requests, results.append)
        wall = time.perf_counter() - started
        rows.append(
            {
                "generation": generation,
                "actors": pool.size,
                "wall_seconds": round(wall, 3),
                **columns(nes.task, results),
            }
        )
        print(f"generation {generation}, {pool.size} actor(s): {wall:.2f} s", flush=True)
    return rows


def main() -> None:
    """Write `results/scaling_pool.json`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("task")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--generations", type=int, nargs="+", required=True)
    parser.add_argument("--home", type=Path, required=True)
    args = parser.parse_args()
    nes = NES(get_task(args.task), load_preset("tuned", args.task, "antithetic"), args.seed)
    overheads, replays = [], []
    with ray_cluster(None):
        for actors in ACTORS:
            with EvaluationPool(actors) as pool:
                overheads.append(overhead(pool))
                print(overheads[-1], flush=True)
                replays += replayed(pool, nes, args.home, args.generations)
        queued = [driver_by_references(references) for references in QUEUED]
    path = write_result(
        "scaling_pool",
        f"python -m benchmarks.scaling.pool {args.task} --seed {args.seed} "
        f"--generations {' '.join(map(str, args.generations))} --home FOLDER",
        {
            "task": args.task,
            "seed": args.seed,
            "trivial_evaluations": TRIVIAL,
            "overhead": overheads,
            "driver_by_references": queued,
            "replays": replays,
        },
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
