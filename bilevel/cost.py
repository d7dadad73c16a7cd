"""What evaluations cost, in core seconds that are computed from counts alone.

A search that compares costs must get the same ones on every machine, under any load, and each time
it is repeated. So costs are computed from the number of training steps and the
multiplications of a minibatch's pass through the agent's network (`step_cost`; all passes of a step
cost a multiple of it), by the constants below, which are those of a fast core that trains DDQN. The
steps of the initial episodes count like the others, although nothing is learned in them. How much
longer another core takes differs between machines and between kinds of agents
(`benchmarks.speed.cost`, docs/speed.md).
"""

from bilevel.hyperparameters import AgentHyperparameters

#: Seconds of a training step for each multiplication of one pass and for everything else, and of a
#: step on the real task.
MULTIPLICATION, STEP, REAL_STEP = 1e-10, 1.2e-5, 1e-6


def estimated_core_seconds(
    hp: AgentHyperparameters, train_steps: int, real_env_steps: int
) -> float:
    """Seconds that a core takes to train an agent for so many steps and to test it."""
    return train_steps * (STEP + MULTIPLICATION * hp.step_cost) + REAL_STEP * real_env_steps
