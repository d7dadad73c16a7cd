"""hpbandster's BOHB as a function of its seed, the number of the proposal and earlier results.

hpbandster is unmaintained. It draws from numpy's global generator and uses names that ConfigSpace
has deprecated. Both are handled here and nowhere else.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import ConfigSpace as CS
import numpy as np
from hpbandster.core.dispatcher import Job as HpbandsterJob
from hpbandster.optimizers.config_generators.bohb import BOHB

from bilevel.errors import InvalidInput
from bilevel.seeds import Purpose, derive, split
from cluster.bohb.study.journal import Configuration, ResultLine
from search_spaces.prior import around
from search_spaces.translation import native

#: Share of the random configurations that are drawn around the prior. The others protect the search
#: from a misleading prior.
AROUND = 0.5
#: Share of random configurations once the model can propose.
_RANDOM_FRACTION = 1 / 3


class ConfigGenerator:
    """Proposes configurations; `model` False proposes random ones only.

    With a `prior`, the first proposal is the prior, and about half of the random ones are drawn
    around it.
    """

    def __init__(
        self,
        space: CS.ConfigurationSpace,
        seed: int,
        model: bool = True,
        prior: Configuration | None = None,
    ) -> None:
        self._space = space
        self._seed = seed
        self._prior = prior
        with _isolated(0):
            self._bohb = BOHB(space, random_fraction=_RANDOM_FRACTION if model else 1.0)

    def propose(self, number: int, budget: float) -> tuple[Configuration, dict[str, Any]]:
        """Return the proposal with that number, from 0, and its `ConfigLine.info`."""
        if self._prior is not None and number == 0:
            return dict(self._prior), {"model_based_pick": False, "prior": "itself"}
        seed = derive(self._seed, Purpose.PROPOSAL, number)
        model_seed, space_seed, prior_seed = (word % 2**32 for word in split(seed, 3))
        self._space.seed(space_seed)
        with _isolated(model_seed):
            configuration, info = self._bohb.get_config(budget)
        rng = np.random.default_rng(prior_seed)
        if self._prior is not None and not info["model_based_pick"] and rng.random() < AROUND:
            with suppress(InvalidInput):  # the space forbids the draw
                configuration = around(self._space, self._prior, rng)
                info = {**info, "prior": True}
        return {name: native(value) for name, value in configuration.items()}, dict(info)

    def learn(self, line: ResultLine, configuration: Configuration) -> None:
        """Update the model with a result."""
        # hpbandster imputes values of inactive hyperparameters at random.
        seed = derive(self._seed, Purpose.IMPUTATION, *line.id, line.budget)
        with _isolated(seed % 2**32):
            self._bohb.new_result(hpbandster_job(line, configuration))


def hpbandster_job(line: ResultLine, configuration: Configuration) -> HpbandsterJob:
    """Convert a result to the job that hpbandster's brackets and model take."""
    job = HpbandsterJob(line.id, config=configuration, budget=line.budget)
    job.result = None if line.loss is None else {"loss": line.loss, "info": line.info}
    job.timestamps = line.timestamps
    job.exception = line.exception
    return job


@contextmanager
def _isolated(seed: int) -> Iterator[None]:
    """Seed and restore numpy's global generator, and ignore warnings: hpbandster treats a warning
    that is raised as an error as a failure of its model, and proposes a random configuration."""
    state = np.random.get_state()
    np.random.seed(seed)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        np.random.set_state(state)
