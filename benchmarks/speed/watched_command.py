"""Runs `bilevel` up to its first evaluation and prints JSON lines of each part of the start and its
seconds since BEGUN.

    python -m benchmarks.speed.watched_command BEGUN nes CartPole-v0 ...

BEGUN is the start of the process, unix time in seconds.
"""

import json
import sys
import time
from typing import Any

#: Parts of the start, in order.
PARTS = ("python", "imports", "ray", "mlflow and actors", "first evaluation")


def main() -> None:
    """Run the command in this process."""
    begun = float(sys.argv.pop(1))

    def tell(part: str, at: float | None = None) -> None:
        print(json.dumps([part, (at or time.time()) - begun]), flush=True)

    tell("python")
    import ray

    import cluster.cli.program
    import cluster.nes.command
    from cluster.ray.pool import EvaluationPool

    tell("imports")
    ray_init, pool_run = ray.init, EvaluationPool.run

    def init(*args: Any, **kwargs: Any) -> Any:
        result = ray_init(*args, **kwargs)
        tell("ray")
        return result

    def run(pool: EvaluationPool, task: Any, se: Any, requests: Any, *_: Any) -> Any:
        def stop(result: Any) -> None:
            tell("mlflow and actors", time.time() - result.seconds)
            tell("first evaluation")
            raise KeyboardInterrupt

        return pool_run(pool, task, se, requests[:1], stop)  # a batch of one request

    ray.init = init
    EvaluationPool.run = run  # type: ignore[assignment,method-assign]
    cluster.cli.main()


if __name__ == "__main__":
    main()
