from typing import Any

import numpy as np

from benchmarks.search.pictures import compared
from cluster.bohb.study.profiles import METHODS


def test_each_search_is_a_point_over_its_method() -> None:
    def fresh(cost: float) -> list[dict[str, Any]]:
        return [{"core_seconds": cost, "solved": solved} for solved in (True, False)]

    measured: dict[str, Any] = {"default": {"fresh": fresh(30)}}
    for place, method in enumerate(METHODS):
        for seed in range(3):
            row = {"method": method, "seed": seed, "fresh": fresh(10 * place + seed + 1)}
            measured[f"{method} {seed}"] = row
    (axes,) = compared("CartPole-v0", measured).axes
    assert [label.get_text() for label in axes.get_xticklabels()] == [*METHODS.values()]
    # Two runs of which one is solved: it has cost both.
    costs = np.array([[2 * (10 * place + seed + 1) for seed in range(3)] for place in range(3)])
    points = [np.asarray(artist.get_offsets()) for artist in axes.collections]
    np.testing.assert_array_equal(
        [one for one in points if len(one) == 3],
        [[(place, cost) for cost in of] for place, of in enumerate(costs)],
    )
    *of_a_seed, default = (np.asarray(line.get_ydata()) for line in axes.lines)
    np.testing.assert_array_equal(of_a_seed, costs.T)
    np.testing.assert_array_equal(default, 60)
