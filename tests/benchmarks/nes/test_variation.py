from pathlib import Path

import numpy as np
import pytest

from benchmarks.nes.variation import WAYS, beside_fixed, cost, drawn
from bilevel.synthetic_env import Architecture, StoredSE, save_se
from bilevel.tasks import Task
from search_spaces.agent_variation import SMALL


def test_ways_differ_in_the_agents() -> None:
    agents = {way: drawn("CartPole-v0", way, range(12)) for way in WAYS}
    kinds = {way: {agent.agent for agent in found} for way, found in agents.items()}
    assert kinds.pop("mixed agents, small and varied") == {"ddqn", "dueling-ddqn", "td3"}
    assert all(kind == {"ddqn"} for kind in kinds.values())
    different = {way: len(set(found)) for way, found in agents.items()}
    assert different.pop("fixed agents") == 1
    assert set(different.values()) == {12}
    dear = {way: any(agent.step_cost > SMALL for agent in found) for way, found in agents.items()}
    assert dear["fully varied agents"]
    assert not dear["small varied agents"]
    assert not dear["mixed agents, small and varied"]


@pytest.mark.parametrize("way", ["fixed agents", "mixed agents, small and varied"])
def test_an_evaluation_costs_time_and_steps(cartpole: Task, tmp_path: Path, way: str) -> None:
    architecture = Architecture(4, 2, 1, 8, "relu", step_limit_share=0.05)
    psi = architecture.initialize(np.random.default_rng(0))
    *_, done = architecture.split(psi)
    done *= 0  # no episode ends before its limit
    file = tmp_path / "se.safetensors"
    save_se(StoredSE(architecture, psi, cartpole.id, 200, 195.0), file)
    found = cost(cartpole.id, file, way, range(3))
    assert found["seconds"] > 0
    assert found["train_steps"] >= 30 * 10  # ten random episodes, and twenty that converge


def test_costs_are_compared_within_a_repeat() -> None:
    repeats = [
        {
            "fixed agents": {"seconds": fixed, "train_steps": 1000.0},
            "fully varied agents": {"seconds": varied, "train_steps": 1500.0},
        }
        for fixed, varied in ((1.0, 2.0), (10.0, 30.0), (100.0, 400.0))
    ]
    found = beside_fixed(repeats, "fully varied agents")
    assert found["seconds"] == {"median": 3.0, "low": 2.0, "high": 4.0}
    assert found["train_steps"]["median"] == 1.5
    assert beside_fixed(repeats, "fixed agents")["seconds"]["high"] == 1.0
