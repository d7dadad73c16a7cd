"""A search space: one that comes with the package, or one of the user's from a file.

ConfigSpace is imported where a space is built: trials know theirs without.
"""

import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import yaml

from bilevel.errors import InvalidInput, one_of
from bilevel.hyperparameters import Hyperparameters
from search_spaces import SPACES
from search_spaces.translation import INVERSE, to_hyperparameters

if TYPE_CHECKING:
    from ConfigSpace import ConfigurationSpace

#: Configurations of a space that are tried before it is used.
_TRIED = 256

#: What ConfigSpace and YAML raise for content that is no space.
_DAMAGE = (
    AttributeError,
    IndexError,
    KeyError,
    RecursionError,
    TypeError,
    ValueError,
    yaml.YAMLError,
)


@dataclass(frozen=True)
class Space:
    """The name of one of SPACES, or of a file, and then its content as ConfigSpace writes it."""

    name: str
    content: dict[str, Any] | None = None

    @classmethod
    def of(cls, given: str) -> Self:
        """The space of that name, or of that file: JSON or YAML as ConfigSpace's `to_json` and
        `to_yaml` write them. Raises InvalidInput."""
        path = Path(given)
        if path.suffix not in (".json", ".yaml", ".yml"):
            if given not in SPACES:
                raise one_of("search space", given, (*SPACES, "and files (*.json, *.yaml)"))
            return cls(given)
        try:
            text = path.read_text()
            content = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
            json.dumps(content)  # as the settings of a study hold it; YAML has more types
        except OSError as error:
            reason = error.strerror or str(error)
            raise InvalidInput(f"cannot read the search space {given!r}: {reason}") from None
        except _DAMAGE as error:
            raise InvalidInput(f"search space {given!r}: {' '.join(str(error).split())}") from None
        space = cls(path.stem, content if content is not None else {})
        space.build()
        return space

    def build(
        self, agents: Sequence[str] = ("ddqn",), seed: int | None = None
    ) -> "ConfigurationSpace":
        """The space for these agents; one from a file is for those that it names. Raises
        InvalidInput for content that is no space."""
        import ConfigSpace as CS

        from search_spaces.bohb import search_space

        if self.content is None:
            return search_space(self.name, agents, seed)
        try:
            # A copy, because ConfigSpace takes entries out of what it reads.
            space = CS.ConfigurationSpace.from_serialized_dict(deepcopy(self.content))
        except _DAMAGE as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InvalidInput(
                f"search space {self.name!r} is not one that ConfigSpace writes: {reason}"
            ) from None
        if any(isinstance(d, CS.OrdinalHyperparameter) for d in space.values()):
            raise InvalidInput(
                f"search space {self.name!r} has ordinal hyperparameters: BOHB's model allows "
                "floats, integers and categories"
            )
        for name, dimension in space.items():
            ends = [getattr(dimension, end, 0.0) for end in ("lower", "upper")]
            if not all(map(math.isfinite, ends)):
                raise InvalidInput(
                    f"search space {self.name!r}: {name} must have finite ends; got {ends}"
                )
        if not len(space):
            raise InvalidInput(f"search space {self.name!r} has no hyperparameters")
        if seed is not None:
            space.seed(seed)
        return space

    def searched(self, agents: Sequence[str] = ("ddqn",)) -> frozenset[str]:
        """Names, `section.field`, of the hyperparameters for which every configuration has a value,
        be it of one minus the hyperparameter."""
        space = self.build(agents)
        always = set(space) - {*space.conditional_hyperparameters}
        return frozenset(name.replace(f".{INVERSE}", ".", 1) for name in always)

    def fitting(self, name: str, least: int) -> Self:
        """The space; one that comes with the package with a whole-numbered dimension that begins at
        `least` or above, and ends at twice as much or above."""
        import ConfigSpace as CS

        if self.content is not None:
            return self
        space = self.build()
        given = space.get(name)
        if not isinstance(given, CS.UniformIntegerHyperparameter) or given.lower >= least:
            return self
        raised = CS.Integer(name, (least, max(given.upper, 2 * least)), log=given.log)
        dimensions = [raised if one is given else one for one in space.values()]
        fitted = CS.ConfigurationSpace(name=self.name, space=dimensions)
        return type(self)(self.name, dict(fitted.to_serialized_dict()))

    def without(self, names: Collection[str]) -> Self:
        """The space; one that comes with the package without the dimensions of these names."""
        import ConfigSpace as CS

        if self.content is not None or not set(names) & set(self.build()):
            return self
        dimensions = [one for name, one in self.build().items() if name not in names]
        left = CS.ConfigurationSpace(name=self.name, space=dimensions)
        return type(self)(self.name, dict(left.to_serialized_dict()))

    def check(
        self,
        base: Hyperparameters,
        reserved: Sequence[str] = (),
        fits: Callable[[Hyperparameters], object] = lambda hp: None,
    ) -> None:
        """Raise InvalidInput if the space sets a hyperparameter that `base` does not have, one that
        is `reserved`, one twice, values that are not allowed beside those of `base`, or a
        combination that `fits` does not accept."""
        agents = tuple(hp.agent for hp in base.agents)
        space, what = self.build(agents), f"search space {self.name!r}"
        taken = sorted(set(reserved) & set(space))
        if taken:
            raise InvalidInput(f"{what}: {taken[0]} is set by the search itself")
        space.seed(0)
        default = dict(space.get_default_configuration())
        drawn = [dict(configuration) for configuration in space.sample_configuration(_TRIED)]
        for configuration in (default, *_at_ends(space, default), *drawn):
            try:
                fits(to_hyperparameters(base, configuration))
            except InvalidInput as error:
                raise InvalidInput(f"{what}: {error}") from None


def _at_ends(space: "ConfigurationSpace", default: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """The default configuration with one value at either end of its range, or another choice; those
    that the space allows."""
    import ConfigSpace as CS

    for name, dimension in space.items():
        if name not in default:
            continue
        choices = getattr(dimension, "choices", None)
        if choices is None:
            choices = [dimension.to_value(end) for end in (0.0, 1.0)]
        for choice in choices:
            try:
                configuration = CS.Configuration(space, values={**default, name: choice})
            except ValueError:  # it is forbidden, or activates others
                continue
            yield dict(configuration)
