"""All scenarios, from the committed measurements.

python -m benchmarks.scaling.simulate
"""

from dataclasses import asdict
from typing import Any

from benchmarks.machine import write_result
from benchmarks.scaling import alternatives, generations, ordering, validation
from benchmarks.scaling.recorded import (
    TASKS,
    configuration_levels,
    pool_overhead,
    recorded_run,
    study_overhead,
    varied_generations,
)
from benchmarks.scaling.searches import Splits

#: Cores of the tables about one generation; none beyond its evaluations is of use.
SHARES = (2, 8, 16, 24, 32, 48, 64, 256, 1024)
ORDERED = (2, 8, 16, 24, 32)
WAITING = (2, 8, 16, 24, 32, 48)


def of_generations(task: str) -> dict[str, Any]:
    """Everything about one run's generations."""
    run, varied, overhead = recorded_run(task), varied_generations(task), pool_overhead()
    found = generations.cases(run, varied)
    return {
        "spread": {name: generations.spread(case) for name, case in found.items()},
        "by_cores": {
            name: generations.by_cores(case, SHARES, overhead) for name, case in found.items()
        },
        "stages": generations.stages(run, overhead),
        "ordering": {
            "fixed agents": ordering.ordering(run, ORDERED, overhead),
            "varied agents": ordering.ordering_of_varied(varied, ORDERED, overhead),
        },
        "asynchronous": {
            name: alternatives.asynchronous(case, run.between, WAITING, overhead)
            for name, case in found.items()
        },
        # 48 evaluations of varied agents tell too little of the longest of hundreds.
        "larger_population": {
            name: alternatives.larger_population(case, overhead)
            for name, case in found.items()
            if len(case) > 1
        },
    }


def main() -> None:
    """Write `results/scaling_simulated.json`."""
    run = recorded_run(TASKS[0])
    levels = configuration_levels(run.task).tolist()
    searches = Splits(run, levels, pool_overhead(), study_overhead())
    path = write_result(
        "scaling_simulated",
        "python -m benchmarks.scaling.simulate",
        {
            "pool_overhead": asdict(pool_overhead()),
            "study_overhead": asdict(study_overhead()),
            "validation": {
                "pool": validation.of_the_pool(),
                "study": validation.of_the_study(),
            },
            "generations": {task: of_generations(task) for task in TASKS},
            "search": {
                "task": run.task,
                "profile": "paper",
                "splits": searches.all(),
                "longer": searches.longer(),
            },
        },
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
