"""Run `bilevel` up to its first evaluation and report when each part of the start ends.

    python -m benchmarks.speed.watched_command STARTED nes CartPole-v0 ...

STARTED is the start of the process in unix time. Each part is printed as a JSON line with its name
and the seconds since STARTED.
"""

import json
import sys
import time
from typing import Any

#: Parts of the start, in order.
PARTS = ("python", "imports", "ray", "mlflow and actors", "first evaluation")


def main() -> None:
    """Run the command in this process."""
    started = float(sys.argv.pop(1))

    def report(part: str, at: float | None = None) -> None:
        print(json.dumps([part, (at or time.time()) - started]), flush=True)

    report("python")
    import ray

    import cluster.cli.program
    import cluster.nes.command
    from cluster.ray.pool import EvaluationPool

    report("imports")
    ray_init, pool_run = ray.init, EvaluationPool.run

    def init(*args: Any, **kwargs: Any) -> Any:
        result = ray_init(*args, **kwargs)
        report("ray")
        return result

    def run(pool: EvaluationPool, task: Any, se: Any, requests: Any, *_: Any) -> Any:
        def stop(result: Any) -> None:
            report("mlflow and actors", time.time() - result.seconds)
            report("first evaluation")
            raise KeyboardInterrupt

        return pool_run(pool, task, se, requests[:1], stop)  # a batch of one request

    ray.init = init
    EvaluationPool.run = run  # type: ignore[assignment,method-assign]
    cluster.cli.main()


if __name__ == "__main__":
    main()
