"""Learning synthetic environments with evolution strategies: the method.

After Ferreira, Nierhoff and Hutter, "Learning Synthetic Environments for
Reinforcement Learning with Evolution Strategies" (2021).

The public names of each room stand in its `__init__`: `bilevel.tasks`,
`bilevel.synthetic_env`, `bilevel.hyperparameters`, `bilevel.agents`,
`bilevel.evaluation`, `bilevel.nes`. Importing this package registers the
gymnasium environment `bilevel/SyntheticEnv-v0`.
"""

from bilevel.errors import InvalidInput
from bilevel.gym_env import register
from bilevel.version import __version__

__all__ = ["InvalidInput", "__version__"]

register()
