"""How much of the cores' time a search spends in evaluations: a study of the local profile,
cut short.

    python -m benchmarks.speed.utilisation
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.machine import write_result
from cluster.bohb.journal import Journal

TIME_BUDGET = "4m"


def main() -> None:
    """Run the study as a user does, write `results/utilisation.json`."""
    script = Path(sys.executable).with_name("bilevel")
    arguments = ["bohb", "CartPole-v0", "--time-budget", TIME_BUDGET, "--study", "utilisation"]
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        subprocess.run([script, *arguments, "--home", folder], check=True)
        minutes = (time.perf_counter() - started) / 60
        results = Journal(Path(folder) / "CartPole-v0" / "utilisation").results
    path = write_result(
        "utilisation",
        "python -m benchmarks.speed.utilisation",
        {
            "time_budget": TIME_BUDGET,
            "minutes": round(minutes, 2),
            "results": len(results),
            "generations": sum(line.budget for line in results),
            "core_utilisation": results[-1].info["core_utilisation"],
        },
    )
    print(path.read_text())


if __name__ == "__main__":
    main()
