"""Estimated cost of evaluations, in core seconds.

A search must compute the same costs on every machine and under any load. So the cost is computed
from the number of training steps and the multiplications of a minibatch's pass through the network
(`step_cost`); all passes of a step cost a multiple of it. The constants are those of a fast core
that trains DDQN. Steps of the initial episodes count like all others. `benchmarks.speed.cost`
compares the estimate with measured time (docs/speed.md).
"""

from bilevel.hyperparameters import AgentHyperparameters

#: Seconds of a training step per multiplication of one pass, of the rest of a training step, and of
#: a step on the real task.
MULTIPLICATION, STEP, REAL_STEP = 1e-10, 1.2e-5, 1e-6


def estimated_core_seconds(
    hp: AgentHyperparameters, train_steps: int, real_env_steps: int
) -> float:
    """Core seconds of an agent's training and tests."""
    return train_steps * (STEP + MULTIPLICATION * hp.step_cost) + REAL_STEP * real_env_steps
