"""The experiments, one file each: agents to train, data, pictures and summary."""

from cluster.experiments.figures.behaviour import BEHAVIOUR
from cluster.experiments.figures.cost import COST
from cluster.experiments.figures.sample_efficiency import SAMPLE_EFFICIENCY
from cluster.experiments.figures.sensitivity import SENSITIVITY
from cluster.experiments.figures.success import SUCCESS
from cluster.experiments.figures.transfer import TRANSFER

#: All experiments by name, in the order of the paper, followed by those beyond it.
EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (SUCCESS, TRANSFER, BEHAVIOUR, SAMPLE_EFFICIENCY, SENSITIVITY, COST)
}
