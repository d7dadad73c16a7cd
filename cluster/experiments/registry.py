"""All experiments by name."""

from bilevel.errors import one_of
from cluster.experiments.experiment import Experiment
from cluster.experiments.figures.behaviour import BEHAVIOUR
from cluster.experiments.figures.cost import COST
from cluster.experiments.figures.sample_efficiency import SAMPLE_EFFICIENCY
from cluster.experiments.figures.sensitivity import SENSITIVITY
from cluster.experiments.figures.success import SUCCESS
from cluster.experiments.figures.transfer import TRANSFER
from cluster.experiments.run import REPORT

#: In the order of the paper, then those beyond it.
EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (SUCCESS, TRANSFER, BEHAVIOUR, SAMPLE_EFFICIENCY, SENSITIVITY, COST)
}

#: All of them, one after the other, and then the report.
ALL = "all"


def get_experiments(name: str) -> list[Experiment]:
    """The experiment of that name, or all of them; none for the report. Raises InvalidInput."""
    if name == REPORT:
        return []
    if name == ALL:
        return list(EXPERIMENTS.values())
    if name not in EXPERIMENTS:
        raise one_of("experiment", name, (*EXPERIMENTS, ALL, REPORT))
    return [EXPERIMENTS[name]]


def explanation_of(name: str) -> str:
    """What an experiment shows, in a sentence or two; of a name from a file, which may be
    unknown."""
    if name in EXPERIMENTS:
        return EXPERIMENTS[name].explanation
    return "All experiments of the task beside the authors' figures." if name == REPORT else ""
