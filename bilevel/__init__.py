"""Learn synthetic environments (SEs) with evolution strategies.

An SE is a small neural network that replaces an environment: agents that train on it perform well
on the real task. This package implements Ferreira, Nierhoff and Hutter, "Learning Synthetic
Environments for Reinforcement Learning with Evolution Strategies" (2021).

Learn an SE, save it, and use it as a gymnasium environment::

    import bilevel, gymnasium

    se = bilevel.learn("CartPole-v0", seed=0, workers=2)
    bilevel.save(se, "se.safetensors")
    env = gymnasium.make("bilevel/SyntheticEnv-v0", path="se.safetensors")

Importing this package registers gymnasium environments: `bilevel/SyntheticEnv-v0` for any SE, and
one for each SE of the zoo (`bilevel/Synthetic-CartPole-v0`, ...). The other names are imported on
first use, so that importing the package loads neither numba nor torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bilevel import gym
from bilevel.errors import InvalidInput
from bilevel.version import __version__

if TYPE_CHECKING:
    from bilevel.evaluation import evaluate
    from bilevel.nes import NES, learn
    from bilevel.recipes import load_recipe
    from bilevel.synthetic_env import save_se as save
    from bilevel.synthetic_env.source import load
    from bilevel.tasks import get_task

__all__ = [
    "NES",
    "InvalidInput",
    "__version__",
    "evaluate",
    "get_task",
    "learn",
    "load",
    "load_recipe",
    "save",
]

#: Module and attribute of each name that is imported on first use.
_LAZY = {
    "NES": ("bilevel.nes", "NES"),
    "evaluate": ("bilevel.evaluation", "evaluate"),
    "get_task": ("bilevel.tasks", "get_task"),
    "learn": ("bilevel.nes", "learn"),
    "load": ("bilevel.synthetic_env.source", "load"),
    "load_recipe": ("bilevel.recipes", "load_recipe"),
    "save": ("bilevel.synthetic_env", "save_se"),
}


def __getattr__(name: str) -> Any:
    """Import a name of `_LAZY` (PEP 562)."""
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _LAZY[name]
    return getattr(import_module(module), attribute)


gym.register()
