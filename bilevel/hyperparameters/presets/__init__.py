"""The paper's hyperparameter tables as data files, and what was measured since.

A file holds the columns of the paper's tables as printed, in the sections `nes`,
`se` and one an agent; what a file does not tell of an agent, the default table does.
A section `updates.NAME` replaces values when that update is asked for, as step sizes mean
different things to different updates: of `nes` and of `se`. It also tells whether agents
are varied, and whether they are those of the default table whatever the file tells.
"""

import tomllib
from collections.abc import Sequence
from importlib.resources import files

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters.agents import agent_hyperparameters
from bilevel.hyperparameters.definitions import (
    UPDATES,
    Hyperparameters,
    NESHyperparameters,
    SEHyperparameters,
)

#: `tuned` is the paper's Table 1, one file a task; `default` its default table.
PRESETS = ("tuned", "default")

DEFAULT_UPDATE = "paired"
DEFAULT_AGENT = "ddqn"


def best_preset(task_id: str) -> str:
    """`tuned` if the paper tuned for that task, else `default`."""
    return "tuned" if (files(__name__) / f"tuned-{task_id}.toml").is_file() else "default"


def load_preset(
    name: str,
    task_id: str,
    update: str = DEFAULT_UPDATE,
    agents: Sequence[str] = (DEFAULT_AGENT,),
) -> Hyperparameters:
    """The preset `tuned` or `default` for a task, with the given NES update and agents.

    An agent that no table knows has the defaults of its own fields.

    Raises InvalidInput for an unknown name, or a task that has not been tuned.
    """
    if name not in PRESETS:
        raise one_of("preset", name, PRESETS)
    if update not in UPDATES:
        raise one_of("update", update, UPDATES)
    file = files(__name__) / ("default.toml" if name == "default" else f"tuned-{task_id}.toml")
    if not file.is_file():
        raise InvalidInput(f"no preset 'tuned' for the task {task_id!r}: allowed is default")
    default = tomllib.loads((files(__name__) / "default.toml").read_text())
    values = default | tomllib.loads(file.read_text())
    own = values.get("updates", {}).get(update, {})
    tables = default if own.get("default_agents") else values
    return Hyperparameters(
        nes=NESHyperparameters.from_dict(values["nes"] | own.get("nes", {}) | {"update": update}),
        se=SEHyperparameters.from_dict(values["se"] | own.get("se", {})),
        agents=tuple(
            agent_hyperparameters(agent).from_dict(tables.get(agent, {})) for agent in agents
        ),
        vary_agent=own.get("vary_agent", "no"),
    )
