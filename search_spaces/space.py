"""Search spaces, from this package or from a user's file.

ConfigSpace is imported only where a space is built, because trials run without it.
"""

import json
from collections.abc import Callable, Collection, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import yaml

from bilevel.errors import InvalidInput, unknown_value
from bilevel.hyperparameters import Hyperparameters
from search_spaces import SPACES
from search_spaces.translation import INVERSE, to_hyperparameters

if TYPE_CHECKING:
    from ConfigSpace import ConfigurationSpace

#: Random configurations that a check tries.
_SAMPLES = 256


@dataclass(frozen=True)
class Space:
    """Name of one of SPACES, or the name and content of a file that ConfigSpace has written."""

    name: str
    content: dict[str, Any] | None = None

    @classmethod
    def of(cls, given: str) -> Self:
        """Return the space with that name, or read it from a file that ConfigSpace's `to_json` or
        `to_yaml` has written. Raises InvalidInput."""
        path = Path(given)
        if path.suffix not in (".json", ".yaml", ".yml"):
            if given not in SPACES:
                raise unknown_value("search space", given, (*SPACES, "and files (*.json, *.yaml)"))
            return cls(given)
        try:
            text = path.read_text()
            content = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
            json.dumps(content)  # settings are JSON; YAML has more types
        except OSError as error:
            reason = error.strerror or str(error)
            raise InvalidInput(f"cannot read the search space {given!r}: {reason}") from None
        except Exception as error:  # ConfigSpace and YAML have no common exception
            raise InvalidInput(f"search space {given!r}: {_one_line(error)}") from None
        space = cls(path.stem, content if content is not None else {})
        space.build()
        return space

    def build(
        self, agents: Sequence[str] = ("ddqn",), seed: int | None = None
    ) -> "ConfigurationSpace":
        """Build the space for these agents; the content of a file does not depend on them. Raises
        InvalidInput for content that ConfigSpace or BOHB's model cannot use."""
        import ConfigSpace as CS

        from search_spaces.bohb import search_space

        if self.content is None:
            return search_space(self.name, agents, seed)
        try:
            # from_serialized_dict removes entries from its argument.
            space = CS.ConfigurationSpace.from_serialized_dict(deepcopy(self.content))
        except Exception as error:
            raise InvalidInput(
                f"search space {self.name!r} is not a ConfigSpace file: {_one_line(error)}"
            ) from None
        if any(isinstance(d, CS.OrdinalHyperparameter) for d in space.values()):
            raise InvalidInput(
                f"search space {self.name!r} has ordinal hyperparameters: BOHB's model allows "
                "floats, integers and categories"
            )
        if not len(space):
            raise InvalidInput(f"search space {self.name!r} has no hyperparameters")
        if seed is not None:
            space.seed(seed)
        return space

    def searched(self, agents: Sequence[str] = ("ddqn",)) -> frozenset[str]:
        """Return the names, `section.field`, of the hyperparameters that every configuration
        sets, directly or as one minus the value."""
        space = self.build(agents)
        always = set(space) - {*space.conditional_hyperparameters}
        return frozenset(name.replace(f".{INVERSE}", ".", 1) for name in always)

    def check(
        self,
        base: Hyperparameters,
        reserved: Collection[str] = (),
        accept: Callable[[Hyperparameters], object] = lambda hp: None,
    ) -> None:
        """Try the default configuration and random ones.

        Raises InvalidInput if the space has a `reserved` dimension or one that `base` lacks, or if
        `base` with the values of a configuration is invalid or not accepted.
        """
        space = self.build(tuple(hp.agent for hp in base.agents))
        for name in sorted(set(reserved) & set(space)):
            raise InvalidInput(f"search space {self.name!r}: {name} is set by the search itself")
        space.seed(0)
        default = space.get_default_configuration()
        for configuration in (default, *space.sample_configuration(_SAMPLES)):
            try:
                accept(to_hyperparameters(base, dict(configuration)))
            except InvalidInput as error:
                raise InvalidInput(f"search space {self.name!r}: {error}") from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
