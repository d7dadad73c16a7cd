import pytest

from benchmarks.nes_starts import searches
from benchmarks.nes_tables import TASKS
from bilevel.hyperparameters import load_preset


@pytest.mark.parametrize("task", TASKS)
def test_neither_search_gets_much_more_evaluations(task: str) -> None:
    crossover, alone = searches(load_preset("tuned", task).nes).values()
    assert crossover.start_crossovers
    assert crossover.start_evaluations == 14 * crossover.evaluations  # as docs/nes.md says
    assert 1.0 <= alone.start_evaluations / crossover.start_evaluations < 1.1
