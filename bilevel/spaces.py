"""Observation and action spaces: gymnasium's outside, flat float32 vectors inside.

An observation becomes a state (S,), flattened as gymnasium does: a discrete value is one-hot. A
discrete action becomes an index from 0, and an action of a Box a vector (M,) in [-1, 1].
"""

import operator
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space, Tuple
from gymnasium.spaces.utils import flatdim, flatten
from gymnasium.vector.utils import concatenate, create_empty_array
from numpy.typing import NDArray

from bilevel.errors import InvalidInput

#: An action as agents and SEs use it: an index, or a vector (M,) in [-1, 1].
Action = int | NDArray[np.float32]

State = NDArray[np.float32]


class Observations:
    """Observations of a space as states (S,). Raises InvalidInput for unsupported spaces."""

    def __init__(self, space: Any, owner: str) -> None:
        for part in _parts(space):
            if isinstance(part, Box) and part.dtype == np.uint8 and len(part.shape) == 3:
                raise InvalidInput(
                    f"{owner} observes images {part.shape}: use a variant with state observations, "
                    "or a wrapper that extracts features"
                )
            if not isinstance(part, Box | Discrete | MultiDiscrete | MultiBinary):
                raise InvalidInput(
                    f"{owner} has observations {part}: allowed are Box, Discrete, MultiDiscrete, "
                    "MultiBinary, and Tuple and Dict of these"
                )
        self.space, self.size = space, int(flatdim(space))
        self._flat = isinstance(space, Box) and len(space.shape) == 1

    def flatten(self, observation: Any) -> NDArray[Any]:
        """Return the state (S,) of an observation, in the dtype of the space. It may share the
        observation's memory. Raises numpy's and gymnasium's errors for other values."""
        return np.asarray(observation if self._flat else flatten(self.space, observation))

    def unflatten(self, state: State) -> Any:
        """Return the observation of the space that is nearest to a state (S,)."""
        return _nearest(self.space, state)

    def unflatten_all(self, states: NDArray[np.float32]) -> Any:
        """Return the observations, batched as gymnasium does, that are nearest to states (N, S)."""
        if self._flat and self.space.dtype == np.float32:
            return states.clip(self.space.low, self.space.high)
        nearest = [self.unflatten(state) for state in states]
        batch: Any = create_empty_array(self.space, len(nearest))
        return concatenate(self.space, nearest, batch)


def _parts(space: Space[Any]) -> list[Space[Any]]:
    """Return the spaces of which a space consists."""
    if not isinstance(space, Tuple | Dict):
        return [space]
    inner = space.spaces.values() if isinstance(space, Dict) else space.spaces
    return [part for child in inner for part in _parts(child)]


def _nearest(space: Any, state: State) -> Any:
    if isinstance(space, Tuple | Dict):
        inner: Any = space.spaces
        children = list(inner.values()) if isinstance(space, Dict) else list(inner)
        ends = np.cumsum([flatdim(child) for child in children])[:-1]
        values = map(_nearest, children, np.split(state, ends))
        return dict(zip(inner, values, strict=True)) if isinstance(space, Dict) else tuple(values)
    if isinstance(space, Discrete):
        return space.start + space.dtype.type(state.argmax())
    if isinstance(space, MultiDiscrete):
        groups = np.split(state, np.cumsum(space.nvec.ravel())[:-1])
        chosen = np.array([group.argmax() for group in groups], space.dtype)
        return chosen.reshape(space.shape) + space.start
    if isinstance(space, MultiBinary):
        return (state > 0.5).astype(space.dtype).reshape(space.shape)
    array = state.reshape(space.shape)
    if np.issubdtype(space.dtype, np.integer):
        array = array.round()
    return array.clip(space.low, space.high).astype(space.dtype)


class Actions:
    """Actions of a Discrete space, or of a bounded Box. Raises InvalidInput for other spaces."""

    def __init__(self, space: Any, owner: str) -> None:
        self.space = space
        self.continuous = isinstance(space, Box)
        if isinstance(space, Discrete):
            self.size, self.first = int(space.n), int(space.start)
            return
        if not isinstance(space, Box) or not np.issubdtype(space.dtype, np.floating):
            raise InvalidInput(
                f"{owner} has actions {space}: allowed are Discrete and a Box of floats"
            )
        if not space.is_bounded():
            raise InvalidInput(
                f"{owner} has actions {space} without bounds: give them finite bounds, for example "
                "by gymnasium.wrappers.RescaleAction"
            )
        self.size = int(np.prod(space.shape))
        low, high = (bound.ravel().astype(np.float64) for bound in (space.low, space.high))
        self._middle = ((low + high) / 2).astype(np.float32)
        self._half = ((high - low) / 2).astype(np.float32)

    def inward(self, action: Any) -> Action:
        """Return an action of the space as agents and SEs use it. Values outside of a Box are
        clipped, as simulators do. Raises InvalidInput for invalid actions."""
        if not self.continuous:
            return checked_index(action, self.size, self.first)
        vector = checked_vector(action, self.space.shape)
        return ((vector.ravel() - self._middle) / self._half).clip(-1, 1)

    def inward_all(self, actions: Any, n: int) -> NDArray[Any]:
        """Return a batch of `n` actions of the space as indices (n,) or vectors (n, M). Raises
        InvalidInput for invalid actions."""
        given, shape = np.asarray(actions), (n, *self.space.shape)
        if self.continuous:
            vectors = checked_vector(given, shape).reshape(n, -1)
            return ((vectors - self._middle) / self._half).clip(-1, 1)
        if given.dtype.kind in "iu" and given.shape == shape:
            indices = given.astype(np.int64) - self.first
            if ((indices >= 0) & (indices < self.size)).all():
                return indices
        raise InvalidInput(f"actions must be {n} elements of {self.space}; got {actions!r}")

    def outward(self, action: Action) -> Any:
        """Invert `inward`. Raises InvalidInput for invalid actions."""
        if not self.continuous:
            return self.first + checked_index(action, self.size)
        vector = np.asarray(action)
        usual = vector.dtype == np.float32 and vector.shape == (self.size,)
        # Python's comparisons of a few numbers are faster than numpy's.
        if not (usual and all(-1 <= value <= 1 for value in vector.tolist())):
            vector = checked_vector(action, (self.size,)).clip(-1, 1)
        values = (self._middle + vector * self._half).reshape(self.space.shape)
        return values if values.dtype == self.space.dtype else values.astype(self.space.dtype)


def checked_action(action: Any, size: int, continuous: bool) -> Action:
    """Return an action as SEs use it. Raises InvalidInput for invalid actions."""
    if not continuous:
        return checked_index(action, size)
    return checked_vector(action, (size,)).clip(-1, 1)


def checked_index(action: Any, size: int, first: int = 0) -> int:
    """Return the index, from 0, of an action of a Discrete space that starts at `first`.

    The action may be an integer of any type, such as a torch tensor. Raises InvalidInput for other
    values.
    """
    try:
        index = operator.index(action) - first
    except TypeError:
        index = -1
    if not 0 <= index < size:
        last = first + size - 1
        raise InvalidInput(f"action {action!r} is not allowed: allowed are {first} to {last}")
    return index


def checked_vector(action: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return an action as a float32 array. Raises InvalidInput for another shape, and for values
    that are not finite."""
    try:
        vector = np.asarray(action, np.float32)
    except (TypeError, ValueError):
        vector = np.full(0, np.nan, np.float32)
    if vector.shape != shape or not np.isfinite(vector).all():
        raise InvalidInput(f"action {action!r} is not allowed: allowed are finite values {shape}")
    return vector
