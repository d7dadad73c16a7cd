"""All experiments by name."""

from bilevel.errors import unknown_value
from cluster.experiments.experiment import Experiment
from cluster.experiments.figures.behaviour import BEHAVIOUR
from cluster.experiments.figures.cost import COST
from cluster.experiments.figures.sample_efficiency import SAMPLE_EFFICIENCY
from cluster.experiments.figures.sensitivity import SENSITIVITY
from cluster.experiments.figures.success import SUCCESS
from cluster.experiments.figures.transfer import TRANSFER
from cluster.experiments.run import REPORT

#: In the order of the paper, followed by those beyond it.
EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (SUCCESS, TRANSFER, BEHAVIOUR, SAMPLE_EFFICIENCY, SENSITIVITY, COST)
}

#: Name of all experiments and the report.
ALL = "all"


def get_experiments(name: str) -> list[Experiment]:
    """Return the experiment of that name, or all of them; none for the report. Raises
    InvalidInput for an unknown name."""
    experiments = {ALL: [*EXPERIMENTS.values()], REPORT: []}
    experiments |= {known: [experiment] for known, experiment in EXPERIMENTS.items()}
    if name not in experiments:
        raise unknown_value("experiment", name, (*EXPERIMENTS, ALL, REPORT))
    return experiments[name]


def explanation_of(name: str) -> str:
    """Return the explanation of an experiment, empty if it is unknown."""
    if name == REPORT:
        return "All experiments of the task, compared with the authors' results."
    return EXPERIMENTS[name].explanation if name in EXPERIMENTS else ""
