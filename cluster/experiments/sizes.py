"""Sizes of experiments: numbers of SEs, agents and NES runs."""

from dataclasses import dataclass, replace
from typing import Any

from bilevel.hyperparameters import AgentHyperparameters, Hyperparameters

#: Agents of one kind that the paper trains on one SE.
AGENTS = 10

#: Training episodes of an agent of a quick size.
QUICK_EPISODES = 5


@dataclass(frozen=True)
class Size:
    """Amount of work of an experiment. A larger size adds to the results of a smaller one."""

    name: str
    ses: int  # SEs per condition (transfer, cost)
    agents: int  # of each kind, on each SE
    real_agents: int  # of each kind, on the real task
    runs: int  # NES runs of our recipe (success)
    authors_runs: int  # NES runs of each of the recipes `authors` and `paper` (success)
    curve_ses: int  # SEs per condition (sample-efficiency)
    curve_agents: int  # on each of them; on the real task curve_ses * curve_agents
    varied_agents: int  # on one SE (sensitivity)
    behaviour_agents: int  # on one SE (behaviour)
    quick: bool = False  # cut NES and training short: a smoke test, not a measurement

    @property
    def prefix(self) -> str:
        """Prefix of the names of all run folders of this size."""
        return f"experiment-{self.name}-" if self.quick else "experiment-"

    def changed(self, ses: int | None, agents: int | None, real_agents: int | None) -> "Size":
        """Return the size with other numbers of SEs per condition, of agents on each SE, and of
        agents on the real task."""
        given: dict[str, Any] = {
            **dict.fromkeys(("ses", "runs", "authors_runs", "curve_ses"), ses),
            **dict.fromkeys(
                ("agents", "curve_agents", "varied_agents", "behaviour_agents"), agents
            ),
            "real_agents": real_agents,
        }
        return replace(self, **{name: n for name, n in given.items() if n is not None})

    def shortened(self, hp: Hyperparameters) -> Hyperparameters:
        """Return the hyperparameters of an NES run of this size."""
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
        """Return the agents with the training episodes of this size."""
        if not self.quick:
            return agents
        return tuple(
            replace(
                hp,
                init_episodes=min(hp.init_episodes, 3),
                max_episodes=QUICK_EPISODES,
                test_episodes=2,  # most of the time goes into the tests on a gymnasium task
            )
            for hp in agents
        )


#: Sizes by name; the values are in the order of the fields.
SIZES = {
    "smoke": Size("smoke", 1, 2, 2, 1, 1, 1, 2, 4, 2, quick=True),
    "local": Size("local", 10, AGENTS, 30, 10, 8, 10, AGENTS, 60, 10),
    "paper": Size("paper", 40, AGENTS, 400, 40, 40, 10, AGENTS, 400, 10),
}
