"""The transitions of one evaluation, for pictures of an agent's behaviour."""

from dataclasses import dataclass, field

from bilevel.agents import Transition
from bilevel.evaluation.run import run_definition
from bilevel.hyperparameters import AgentHyperparameters
from bilevel.synthetic_env import SE
from bilevel.tasks import Task


@dataclass(frozen=True)
class Recording:
    """The transitions of an agent's training and tests."""

    training: list[Transition] = field(default_factory=list)
    tests: list[Transition] = field(default_factory=list)


def record(task: Task, se: SE, hp: AgentHyperparameters, seed: int) -> Recording:
    """The transitions of `train_and_test` with these arguments, by the agent's definition; no tests
    if training diverges. Raises InvalidInput for an SE of a task with other sizes."""
    recording = Recording()
    run_definition(task, se, hp, seed, recording.training, recording.tests)
    return recording
