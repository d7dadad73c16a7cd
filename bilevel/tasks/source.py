"""The source of a task's environment, as one line of text: gymnasium's id, keyword arguments and
wrappers, such as `FrozenLake-v1,is_slippery=False` or `Hopper-v5,wrapper=my_package:Repeat`.
"""

import ast
import re
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self
from urllib.parse import quote, unquote

import gymnasium
from gymnasium.envs.registration import EnvSpec, load_env_creator

from bilevel.errors import InvalidInput

#: A real task in gymnasium.
GymEnv = gymnasium.Env[Any, Any]

#: Key of a wrapper among the keyword arguments.
_WRAPPER = "wrapper"

#: Words in values besides Python's literals.
_WORDS = {"true": True, "false": False, "none": None}


@dataclass(frozen=True)
class EnvSource:
    """How gymnasium makes the environment. `str` and `parse` are inverse to each other."""

    env_id: str  # gymnasium's id, or MODULE:ID for one that a module registers
    kwargs: tuple[tuple[str, Any], ...] = ()  # of the environment, sorted by name
    wrappers: tuple[str, ...] = ()  # MODULE:CLASS, the innermost first

    @classmethod
    def of(cls, text: str, kwargs: Mapping[str, Any], wrappers: Sequence[str]) -> Self:
        """Parse `text` and add keyword arguments and wrappers. Raises InvalidInput."""
        source = cls.parse(text)
        merged = {**dict(source.kwargs), **kwargs}
        whole = cls(source.env_id, tuple(sorted(merged.items())), (*source.wrappers, *wrappers))
        if cls.parse(str(whole)) != whole:
            raise InvalidInput(
                f"{source.env_id}: keyword arguments must be numbers, strings, booleans, None, or "
                f"lists, tuples and dicts of these; got {dict(kwargs)}"
            )
        return whole

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a source. Raises InvalidInput."""
        env_id, *parts = text.split(",")
        pairs = [part.partition("=") for part in parts]
        for (name, sign, value), part in zip(pairs, parts, strict=True):
            if not (name.isidentifier() and sign and value):
                raise InvalidInput(
                    f"task {text!r}: {part!r} is no keyword argument, such as is_slippery=False"
                )
        values = {name: parse_value(unquote(value)) for name, _, value in pairs if name != _WRAPPER}
        wrappers = tuple(unquote(value) for name, _, value in pairs if name == _WRAPPER)
        for wrapper in wrappers:
            if not re.fullmatch(r"[\w.]+:\w+", wrapper):
                raise InvalidInput(f"a wrapper must be MODULE:CLASS; got {wrapper!r}")
        return cls(env_id, tuple(sorted(values.items())), wrappers)

    def __str__(self) -> str:
        pairs = [(name, _value_text(value)) for name, value in self.kwargs]
        pairs += [(_WRAPPER, wrapper) for wrapper in self.wrappers]
        return ",".join([self.env_id, *(f"{name}={value}" for name, value in pairs)])

    @property
    def registered_id(self) -> str:
        """The id in gymnasium's registry."""
        return self.env_id.rpartition(":")[2]

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's specification, if its module has been imported."""
        return gymnasium.registry.get(self.registered_id)

    @property
    def missing_modules(self) -> list[str]:
        """The modules of the id and of wrappers that are not imported."""
        modules = [address.rpartition(":")[0] for address in (self.env_id, *self.wrappers)]
        return [module for module in modules if module and module not in sys.modules]

    def make(self, step_limit: int | None = None, render_mode: str | None = None) -> GymEnv:
        """Create the environment. Raises gymnasium's and the environment's errors, and InvalidInput
        for a wrapper that is not one of gymnasium's `Wrapper` classes."""
        # A task without rendering need not accept the argument.
        kwargs: dict[str, Any] = {} if render_mode is None else {"render_mode": render_mode}
        kwargs |= dict(self.kwargs)
        with warnings.catch_warnings():
            # The paper's CartPole-v0 is not the latest version.
            warnings.filterwarnings("ignore", ".*(out of date|latest versioned)")
            # The environment checker repeats its warnings for every environment.
            env = gymnasium.make(self.env_id, step_limit, disable_env_checker=True, **kwargs)
        for wrapper in self.wrappers:
            wrap: Any = load_env_creator(wrapper)
            if not (isinstance(wrap, type) and issubclass(wrap, gymnasium.Wrapper)):
                raise InvalidInput(f"{wrapper!r} is not a subclass of gymnasium.Wrapper")
            env = wrap(env)
        return env


def parse_value(text: str) -> Any:
    """Parse the value of a keyword argument: a Python literal, true, false, none, or a string."""
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def _value_text(value: Any) -> str:
    plain = isinstance(value, str) and value and parse_value(value) == value
    return quote(value if plain else repr(value), safe="/:()[]{}'+ ")


def registered(env: EnvSpec | Callable[..., GymEnv]) -> EnvSource:
    """Register an environment with gymnasium, if necessary. Raises InvalidInput if its id belongs
    to another environment, and for a specification with wrappers."""
    if isinstance(env, EnvSpec):
        known = gymnasium.registry.get(env.id)
        if env.additional_wrappers:
            names = [wrapper.name for wrapper in env.additional_wrappers]
            raise InvalidInput(f"{env.id}: give the wrappers {names} as wrappers=[MODULE:CLASS]")
        if known is not None and known.entry_point == env.entry_point:
            own = {k: v for k, v in env.kwargs.items() if known.kwargs.get(k) != v}
            return EnvSource.of(env.id, own, ())
        spec = env
    else:
        name = "".join(c for c in getattr(env, "__name__", type(env).__name__) if c.isalnum())
        spec = EnvSpec(f"{name}-v0", entry_point=env)
        known = gymnasium.registry.get(spec.id)
        if known is not None and _same_definition(known.entry_point, env):
            known = None
    if known is not None:
        raise InvalidInput(
            f"the id {spec.id} belongs to another environment: rename yours, or register it with "
            "gymnasium under another id"
        )
    gymnasium.registry[spec.id] = spec
    return EnvSource(spec.id)


def _same_definition(one: Any, other: Any) -> bool:
    """Return whether two functions or classes come from one definition, which a notebook may run
    repeatedly. Functions and classes inside of functions, and lambdas, may differ."""
    names = [
        (getattr(f, "__module__", None), getattr(f, "__qualname__", "<")) for f in (one, other)
    ]
    return one is other or (names[0] == names[1] and "<" not in names[0][1])
