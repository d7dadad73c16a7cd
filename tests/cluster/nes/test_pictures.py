"""The learning curve of an NES run."""

from dataclasses import replace
from typing import get_type_hints

from bilevel.nes import GenerationRecord
from bilevel.tasks import Task
from cluster.nes.pictures import learning_curve


def test_generations_are_whole_and_the_best_is_marked(cartpole: Task) -> None:
    zero = {name: kind(0) for name, kind in get_type_hints(GenerationRecord).items()}
    records = [
        replace(GenerationRecord(**zero), generation=i, score_mean=score)
        for i, score in enumerate((20.0, 180.0, 100.0))
    ]
    figure = learning_curve(records, cartpole, "run")
    figure.canvas.draw()
    scores, steps = figure.axes
    ticks = [tick for tick in steps.get_xticks() if 0 <= tick <= 2]
    assert ticks == [round(tick) for tick in ticks]
    legend = scores.get_legend()
    assert legend is not None
    told = [text.get_text() for text in legend.get_texts()]
    assert "best: 180.0 in generation 1" in told
    assert not any("psi" in text for text in told)
