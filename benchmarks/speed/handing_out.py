"""What an evaluation costs beyond its kernel, when an actor's next request is on its way
early and when it is sent as the actor becomes idle: one actor, the same requests, in turn.

    python -m benchmarks.speed.handing_out
"""

import time
from dataclasses import replace

from benchmarks.machine import spread, write_result
from bilevel.hyperparameters import load_preset
from bilevel.nes import NES
from bilevel.tasks import get_task
from cluster import request_queue
from cluster.pool import EvaluationPool
from cluster.ray_cluster import ray_cluster

REPEATS = 7
#: Of one agent: evaluations are short, so that the rest shows.
EPISODES = 12
MARGINS = {"early": request_queue.EARLY_MARGIN, "when idle": float("inf")}


def main() -> None:
    """Measure both, write `results/handing_out.json`."""
    task, hp = get_task("CartPole-v0"), load_preset("tuned", "CartPole-v0", "antithetic")
    nes = NES(task, hp, 0)
    psi = nes.start().psi
    requests = [
        replace(request, agent=replace(request.agent, max_episodes=EPISODES))
        for request in nes.ask(nes.start())
    ]
    beyond: dict[str, list[float]] = {name: [] for name in MARGINS}
    with ray_cluster("local"), EvaluationPool(1) as pool:
        pool.run(task, nes.architecture, psi, requests)
        for _ in range(REPEATS):
            for name, margin in MARGINS.items():
                request_queue.EARLY_MARGIN = margin
                kernels, started = pool.kernel_seconds, time.perf_counter()
                pool.run(task, nes.architecture, psi, requests)
                seconds = time.perf_counter() - started
                spent = pool.kernel_seconds - kernels
                beyond[name].append((seconds - spent) / len(requests) * 1e3)
    path = write_result(
        "handing_out",
        "python -m benchmarks.speed.handing_out",
        {
            "repeats": REPEATS,
            "evaluations": len(requests),
            "beyond_kernel_ms": {name: spread(values) for name, values in beyond.items()},
        },
    )
    print(path.read_text())


if __name__ == "__main__":
    main()
