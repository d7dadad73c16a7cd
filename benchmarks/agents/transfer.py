"""What an SE that was learned with DDQN teaches an agent of another kind that asks only whether
an episode has ended: the REINFORCE of docs/agents.md, at several discounts.

    python -m benchmarks.agents.transfer CartPole-v0 --agents 20 --home FOLDER

The SE is that of `bilevel nes TASK --name transfer`, which is run (or continued) first.
"""

import argparse
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.machine import write_result
from bilevel.hyperparameters import best_preset, load_preset
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from cluster.agent_files import load_agent_file
from cluster.evaluate_command import EvaluateCommand, run_evaluate
from cluster.evaluation_report import as_json
from cluster.final import BEST_FILE
from cluster.home import Home
from cluster.nes_command import NESCommand, run_nes
from cluster.nes_loop import NESRun
from cluster.place import Place

ROOT = Path(__file__).parents[2]

#: Of REINFORCE.
DISCOUNTS = (0.5, 0.9, 0.99)


def documented_agent() -> str:
    """The code of docs/agents.md."""
    found = re.search(r"```python\n(.*?)```", (ROOT / "docs" / "agents.md").read_text(), re.DOTALL)
    assert found is not None
    return found[1]


def main() -> None:
    """Learn the SE, train agents on it, write `results/transfer_TASK.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--agents", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--home", type=Path, required=True)
    options = parser.parse_args()
    task, home = get_task(options.task), Home(options.home)
    home.prepare()
    file = home.folder / "reinforce.py"
    file.write_text(documented_agent())
    load_agent_file(file)

    hp = load_preset(best_preset(task.id), task.id)
    run = NESRun(task, hp, options.seed, home.run_folder(task.id, "transfer"))
    place = Place(home, home.database_uri)
    state = run_nes(NESCommand(run, place))
    se = load_se(run.folder / BEST_FILE)

    (reinforce,) = load_preset("default", task.id, agents=("reinforce",)).agents
    rows = []
    for discount in DISCOUNTS:
        changed: Any = {"discount": discount}  # a field of the documented agent
        command = EvaluateCommand(
            task,
            {"best_se": se},
            (replace(reinforce, **changed),),
            options.agents,
            "no",
            options.seed,
            f"transfer-{discount}",
            place,
        )
        for group in as_json(run_evaluate(command)):
            rows.append({"discount": discount, **group})
    arguments = [argument for argument in sys.argv[1:] if argument != str(options.home)]
    path = write_result(
        f"transfer_{task.id}",
        f"python -m benchmarks.agents.transfer {' '.join(arguments)} FOLDER",
        {"generations": state.generation, "groups": rows},
    )
    print(f"written to {path}")


if __name__ == "__main__":
    main()
