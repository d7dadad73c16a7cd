import ConfigSpace as CS
import numpy as np

from search_spaces.prior import around, nearest

SPACE = CS.ConfigurationSpace(
    space=[
        CS.Float("float", (0.01, 1.0), log=True),
        CS.Integer("integer", (1, 64)),
        CS.Categorical("category", ("a", "b"), default="b"),
        CS.Constant("constant", 3),
    ]
)


def test_values_outside_the_space_become_the_nearest() -> None:
    found = nearest(SPACE, {"float": 9.0, "integer": 1000, "category": "x", "constant": 5})
    assert found == {"float": 1.0, "integer": 64, "category": "b", "constant": 3}
    assert type(found["integer"]) is int
    CS.Configuration(SPACE, values=found)  # raises outside the space


def test_draws_stay_in_the_space_and_near_the_prior() -> None:
    prior = {"float": 0.1, "integer": 60, "category": "a", "constant": 3}
    rng = np.random.default_rng(0)
    draws = [around(SPACE, prior, rng) for _ in range(300)]
    for draw in draws:
        CS.Configuration(SPACE, values=draw)
    logs = np.log([draw["float"] for draw in draws]) / np.log(100)
    assert abs(logs.mean() - np.log(0.1) / np.log(100)) < 0.05
    assert abs(logs.std() - 0.15) < 0.03
    assert 0.75 < np.mean([draw["category"] == "a" for draw in draws]) < 0.95
