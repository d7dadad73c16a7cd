"""Guards unmaintained hpbandster against current numpy and ConfigSpace releases.

hpbandster catches errors of its model and then proposes random configurations. So an incompatible
release would not fail: it would turn BOHB into random search.
"""

from pathlib import Path

import ConfigSpace as CS
import numpy as np
import pytest
from hpbandster.core.result import logged_results_to_HBS_result

from cluster.bohb.search.config_generator import ConfigGenerator
from cluster.bohb.study.journal import Configuration, ResultLine
from search_spaces import SPACES
from search_spaces.bohb import search_space
from tests.searches import loss_of, new_search, run_to_end

TIMES = {"submitted": 0.0, "started": 0.0, "finished": 1.0}

#: Floats, integers, categories, and a condition, on which hpbandster imputes values.
MIXED = CS.ConfigurationSpace(
    space=[
        CS.Float("float", (0.01, 1.0), log=True),
        CS.Integer("integer", (1, 100), log=True),
        CS.Categorical("category", ("a", "b", "c")),
        CS.Float("conditional", (0.0, 1.0)),
    ]
)
MIXED.add(CS.EqualsCondition(MIXED["conditional"], MIXED["category"], "a"))


@pytest.mark.parametrize("space", [MIXED, *map(search_space, SPACES)], ids=["mixed", *SPACES])
def test_model_based_picks(space: CS.ConfigurationSpace) -> None:
    """Once the model has 2 (d + 1) results, it makes about two thirds of the proposals."""
    first = next(iter(space))

    def loss(configuration: Configuration) -> float:
        return float(space[first].to_vector(configuration[first]))

    generator = ConfigGenerator(space, seed=0)
    losses: dict[bool, list[float]] = {False: [], True: []}
    for number in range(2 * (len(space) + 1) + 60):
        configuration, info = generator.propose(number, 1)
        CS.Configuration(space, values=configuration)  # raises outside the space
        losses[info["model_based_pick"]].append(loss(configuration))
        line = ResultLine((0, 0, number), 1, loss(configuration), {}, TIMES)
        generator.learn(line, configuration)
    assert 25 < len(losses[True]) < 55
    assert np.mean(losses[True]) < np.mean(losses[False])


def test_hpbandster_reads_the_journal(tmp_path: Path) -> None:
    jobs = run_to_end(new_search(tmp_path), fail=(2,))
    result = logged_results_to_HBS_result(str(tmp_path))
    assert len(result.get_all_runs()) == len(jobs)
    best = min((job for job in jobs if job.budget == 9), key=loss_of)
    assert result.get_incumbent_id() == best.id
