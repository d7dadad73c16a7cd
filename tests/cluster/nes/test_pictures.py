"""The learning curve of an NES run."""

from dataclasses import replace
from typing import get_type_hints

import numpy as np

from bilevel.nes import GenerationRecord
from bilevel.tasks import Task
from cluster.nes.pictures import learning_curve


def test_scores_are_drawn_over_whole_generations(cartpole: Task) -> None:
    zero = {name: kind(0) for name, kind in get_type_hints(GenerationRecord).items()}
    expected = [20.0, 180.0, 100.0]
    records = [
        replace(GenerationRecord(**zero), generation=i, score_mean=score)
        for i, score in enumerate(expected)
    ]
    figure = learning_curve(records, cartpole, "run")
    figure.canvas.draw()
    scores, steps = figure.axes
    assert np.array_equal(scores.lines[0].get_ydata(), expected)
    ticks = [tick for tick in steps.get_xticks() if 0 <= tick <= 2]
    assert ticks == [round(tick) for tick in ticks]
