import math
from pathlib import Path
from typing import Any

from benchmarks.search.outcomes import at_smallest, outcomes, quartiles
from cluster.bohb.study.journal import ConfigLine, Journal, Origin, ResultLine

STAMPS = {"submitted": 0.0, "started": 0.0, "finished": 0.0}


def test_proposals_are_compared_where_all_were_run(tmp_path: Path) -> None:
    """At the smallest budget; a failure counts as the worst."""
    journal = Journal(tmp_path)
    infos: list[dict[str, Any]] = [{"prior": "itself"}, {}, {"model_based_pick": True}, {}]
    for number, info in enumerate(infos):
        journal.add_config(ConfigLine((0, 0, number), {}, info))
    for number, budget, loss in ((0, 1, 9.0), (1, 1, None), (2, 1, 7.0), (3, 1, 8.0), (2, 3, 1.0)):
        info = {"confirmed": 2} if loss == 8.0 else {}
        journal.add_result(ResultLine((0, 0, number), budget, loss, info, STAMPS))
    found = outcomes(journal)
    assert found["3"][Origin.MODEL] == [(1.0, 0)]
    assert at_smallest(found) == {
        Origin.RANDOM: [(math.inf, 0), (8.0, 2)],
        Origin.AROUND_RECIPE: [],
        Origin.MODEL: [(7.0, 0)],
    }


def test_what_outran_the_budget_is_scaled_to_it(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.add_config(ConfigLine((0, 0, 0), {}, {}))
    journal.add_result(ResultLine((0, 0, 0), 30, 80.0, {"core_seconds": 40.0}, STAMPS))
    assert at_smallest(outcomes(journal))[Origin.RANDOM] == [(80.0, 0)]
    assert at_smallest(outcomes(journal, at_budget=True))[Origin.RANDOM] == [(60.0, 0)]


def test_quartiles_of_failures() -> None:
    assert quartiles([1.0, 2.0, 4.0, 8.0]) == "3 (2 to 5)"
    assert quartiles([10.0, math.inf, math.inf, math.inf]) == "inf (10 to inf)"
    assert quartiles([10.0, 20.0, 30.0, 40.0, math.inf]) == "30 (20 to 40)"
