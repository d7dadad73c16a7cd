"""Search spaces, from this package or from a user's file.

ConfigSpace is imported only where a space is built, because trials run without it.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from bilevel.errors import InvalidInput, unknown_value
from search_spaces import SPACES
from search_spaces.translation import INVERSE

if TYPE_CHECKING:
    from ConfigSpace import ConfigurationSpace


@dataclass(frozen=True)
class Space:
    """Name of one of SPACES, or the name and content of a file that ConfigSpace has written."""

    name: str
    content: dict[str, Any] | None = None

    @classmethod
    def of(cls, given: str) -> Self:
        """Return the space with that name, or read it from a file that ConfigSpace's `to_json` has
        written. Raises InvalidInput."""
        if not given.endswith(".json"):
            if given not in SPACES:
                raise unknown_value("search space", given, (*SPACES, "and files (*.json)"))
            return cls(given)
        import ConfigSpace as CS

        try:
            space = CS.ConfigurationSpace.from_json(given)
        except Exception as error:  # ConfigSpace has no common exception
            reason = " ".join(str(error).split())
            raise InvalidInput(f"cannot read the search space {given!r}: {reason}") from None
        ordinal = any(isinstance(d, CS.OrdinalHyperparameter) for d in space.values())
        if ordinal or not len(space):  # BOHB's model has no kernel for ordinals
            raise InvalidInput(
                f"search space {given!r} must contain only floats, integers, categories and "
                "constants"
            )
        return cls(Path(given).stem, dict(space.to_serialized_dict()))

    def build(
        self, agents: Sequence[str] = ("ddqn",), seed: int | None = None
    ) -> "ConfigurationSpace":
        """Build the space for these agents; the content of a file does not depend on them. Raises
        InvalidInput."""
        import ConfigSpace as CS

        from search_spaces.bohb import search_space

        if self.content is None:
            return search_space(self.name, agents, seed)
        # from_serialized_dict removes entries from its argument.
        space = CS.ConfigurationSpace.from_serialized_dict(deepcopy(self.content))
        if seed is not None:
            space.seed(seed)
        return space

    def searched(self, agents: Sequence[str] = ("ddqn",)) -> frozenset[str]:
        """Return the names, `section.field`, of the hyperparameters that every configuration
        sets, directly or as one minus the value."""
        space = self.build(agents)
        always = set(space) - {*space.conditional_hyperparameters}
        return frozenset(name.replace(f".{INVERSE}", ".", 1) for name in always)
