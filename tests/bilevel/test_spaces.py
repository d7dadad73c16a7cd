"""States and actions of all supported spaces."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector.utils import batch_space, iterate

from bilevel import InvalidInput
from bilevel.spaces import Actions, Observations

BOX = Box(np.array([0, -9]), np.array([1, 3]), dtype=np.float32)

OBSERVATIONS: dict[str, Any] = {
    "box": Box(-1, 2, (3,), np.float32),
    "shape": Box(-1, 2, (2, 2), np.float64),
    "integers": Box(0, 9, (2,), np.int16),
    "discrete": Discrete(4, start=-1),
    "multi-discrete": MultiDiscrete([3, 2]),
    "multi-binary": MultiBinary(3),
    "dict": Dict({"a": Discrete(3), "b": Tuple([Box(0, 1, (2,)), MultiBinary(2)])}),
}


@pytest.mark.parametrize("name", OBSERVATIONS)
def test_states_identify_observations(name: str) -> None:
    space = OBSERVATIONS[name]
    space.seed(0)
    observations = Observations(space, "task")
    seen = [space.sample() for _ in range(20)]
    states = np.array([observations.flatten(one) for one in seen], np.float32)
    assert states.shape == (20, observations.size)
    found = [observations.unflatten(state) for state in states]
    assert all(space.contains(one) for one in found)
    if name != "shape":  # float64
        assert all(map(data_equivalence, found, seen))
    batch: Any = observations.unflatten_all(states)
    assert all(map(data_equivalence, iterate(batch_space(space, 20), batch), found))


@pytest.mark.parametrize("name", OBSERVATIONS)
def test_every_state_has_a_nearest_observation(name: str, rng: np.random.Generator) -> None:
    observations = Observations(OBSERVATIONS[name], "task")
    for state in rng.normal(0, 50, (50, observations.size)).astype(np.float32):
        assert OBSERVATIONS[name].contains(observations.unflatten(state))


@pytest.mark.parametrize(
    "space",
    [
        Discrete(3, start=5),
        Box(-2, 2, (1,)),
        Box(np.array([0, -9]), np.array([1, 3]), dtype=np.float32),
    ],
)
def test_actions_and_their_inverse(space: Any) -> None:
    space.seed(0)
    actions = Actions(space, "task")
    given = np.array([space.sample() for _ in range(20)])
    inward = [actions.inward(action) for action in given]
    assert np.abs(np.array(inward)).max() <= (1 if actions.continuous else space.n - 1)
    for action, inner in zip(given, inward, strict=True):
        assert space.contains(np.asarray(actions.outward(inner), space.dtype))
        np.testing.assert_allclose(actions.outward(inner), action, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(actions.inward_all(given, 20), inward)


def test_a_box_has_the_range_minus_one_to_one() -> None:
    actions = Actions(BOX, "task")
    np.testing.assert_allclose(actions.inward([1.0, -9.0]), [1, -1])
    np.testing.assert_allclose(actions.inward([7.0, -3.0]), [1, 0])  # clipped
    np.testing.assert_allclose(actions.outward(np.array([0.5, 0], np.float32)), [0.75, -3])


def test_outward_actions_are_checked_and_clipped() -> None:
    actions = Actions(BOX, "task")
    np.testing.assert_allclose(actions.outward(np.array([3.0, -2.0], np.float32)), [1, -9])
    for wrong in (np.zeros(1, np.float32), np.zeros((1, 2), np.float32), [np.nan, 0.0]):
        with pytest.raises(InvalidInput, match="not allowed"):
            actions.outward(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("space", "action"),
    [
        (Discrete(3, start=5), 4),
        (Discrete(3, start=5), 8),
        (Discrete(3, start=5), 5.5),
        (Box(-2, 2, (1,)), [np.nan]),
        (Box(-2, 2, (1,)), [0.0, 0.0]),
        (Box(-2, 2, (1,)), "left"),
    ],
)
def test_invalid_actions(space: Any, action: Any) -> None:
    with pytest.raises(InvalidInput, match="not allowed"):
        Actions(space, "task").inward(action)
    with pytest.raises(InvalidInput):
        Actions(space, "task").inward_all([action], 1)


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (Box(0, 255, (84, 84, 3), np.uint8), "task observes images .*: use a variant"),
        (gymnasium.spaces.Text(5), "allowed are Box, Discrete"),
        (Tuple([Discrete(2), gymnasium.spaces.Text(5)]), "allowed are Box, Discrete"),
    ],
)
def test_unsupported_observations(space: Any, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        Observations(space, "task")


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (MultiDiscrete([2, 2]), "allowed are Discrete and a Box of floats"),
        (Box(0, 9, (2,), np.int16), "allowed are Discrete and a Box of floats"),
        (Box(-np.inf, np.inf, (2,)), "without bounds"),
    ],
)
def test_unsupported_actions(space: Any, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        Actions(space, "task")
