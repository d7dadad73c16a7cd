"""Sizes of experiments: how many SEs, agents and NES runs each one rests on."""

from dataclasses import dataclass, replace

from bilevel.errors import one_of
from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters

#: Agents of one kind that the paper trains on one SE.
AGENTS = 10


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much work an experiment does; a larger size adds to what a smaller one has done."""

    name: str
    ses: int  # SEs per condition (transfer, cost)
    agents: int  # of each kind, on each SE
    real_agents: int  # of each kind, on the real task
    runs: int  # NES runs of our recipe (success)
    authors_runs: int  # NES runs of each of the recipes `authors` and `paper` (success)
    curve_ses: int  # SEs per condition (sample-efficiency)
    curve_agents: int  # on each of them; as many on the real task as on the SEs of a condition
    varied_agents: int  # on one SE (sensitivity)
    behaviour_agents: int  # on one SE (behaviour)
    quick: bool = False  # cut NES and training short: a check that all works, not a measurement

    @property
    def prefix(self) -> str:
        """Beginning of the names of all run folders of this size."""
        return f"experiment-{self.name}-" if self.quick else "experiment-"

    def changed(self, ses: int | None, agents: int | None, real_agents: int | None) -> "Size":
        """The size with other numbers of SEs per condition, of agents on each, and of agents on the
        real task."""
        size = self
        if ses is not None:
            size = replace(size, ses=ses, runs=ses, authors_runs=ses, curve_ses=ses)
        if agents is not None:
            size = replace(size, agents=agents, curve_agents=agents)
            size = replace(size, varied_agents=agents, behaviour_agents=agents)
        return size if real_agents is None else replace(size, real_agents=real_agents)

    def shortened(self, hp: Hyperparameters) -> Hyperparameters:
        """The hyperparameters of an NES run of this size."""
        if not self.quick:
            return hp
        nes = replace(
            hp.nes,
            generations=2,
            population_size=2,
            centre_agents=2,
            start_candidates=min(hp.nes.start_candidates, 8),
            patient_episodes=min(hp.nes.patient_episodes, QUICK_EPISODES),
        )
        return replace(hp, nes=nes, agents=self.trained(hp.agents))

    def trained(self, agents: tuple[AgentHyperparameters, ...]) -> tuple[AgentHyperparameters, ...]:
        """The agents, as agents of this size train."""
        if not self.quick:
            return agents
        return tuple(
            replace(
                hp,
                init_episodes=min(hp.init_episodes, 3),
                max_episodes=QUICK_EPISODES,
                test_episodes=2,  # a gymnasium task's tests take most of the time
            )
            for hp in agents
        )


#: Training episodes of an agent of a quick size.
QUICK_EPISODES = 5

SIZES = {
    size.name: size
    for size in (
        Size(
            name="smoke",
            ses=1,
            agents=2,
            real_agents=2,
            runs=1,
            authors_runs=1,
            curve_ses=1,
            curve_agents=2,
            varied_agents=4,
            behaviour_agents=2,
            quick=True,
        ),
        Size(
            name="local",
            ses=10,
            agents=AGENTS,
            real_agents=30,
            runs=10,
            authors_runs=8,
            curve_ses=10,
            curve_agents=AGENTS,
            varied_agents=60,
            behaviour_agents=10,
        ),
        Size(
            name="paper",
            ses=40,
            agents=AGENTS,
            real_agents=400,
            runs=40,
            authors_runs=40,
            curve_ses=10,
            curve_agents=AGENTS,
            varied_agents=400,
            behaviour_agents=10,
        ),
    )
}


def get_size(name: str) -> Size:
    """The size of that name. Raises InvalidInput for another one."""
    if name not in SIZES:
        raise one_of("size", name, SIZES)
    return SIZES[name]
