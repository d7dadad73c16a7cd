"""Shared fixtures: small hyperparameters, so that tests can run real training fast."""

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
import torch

from bilevel.decode import decode
from bilevel.hyperparameters import (
    DDQNHyperparameters,
    Hyperparameters,
    StoredHyperparameters,
)
from bilevel.recipes import load_recipe
from bilevel.synthetic_env import save_se
from bilevel.tasks import Task, get_task
from tests.ses import make_se

# Draw windows without a screen, and do not search for audio devices.
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")

# Several processes run tests. If more threads than cores synchronise, small networks take ten times
# as long.
torch.set_num_threads(1)

# Tests must not fail because the machine is busy.
hypothesis.settings.register_profile("no-deadline", deadline=None)
hypothesis.settings.load_profile("no-deadline")

# Tests send these signals to child processes, which inherit ignored signals: SIGINT is ignored in
# background jobs of scripts, SIGHUP under nohup.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


def restored(values: Any) -> Hyperparameters:
    """Return the hyperparameters from which `Hyperparameters.to_dict` made `values`."""
    return decode(StoredHyperparameters, values, "hyperparameters").checked()


def ddqn(hp: Hyperparameters) -> DDQNHyperparameters:
    """Return the agent of a run whose only agent is DDQN."""
    (agent,) = hp.agents
    assert isinstance(agent, DDQNHyperparameters)
    return agent


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def cartpole() -> Task:
    return get_task("CartPole-v0")


@pytest.fixture
def acrobot() -> Task:
    return get_task("Acrobot-v1")


@pytest.fixture
def se_file(tmp_path: Path, cartpole: Task) -> Path:
    """A file with a random SE for CartPole."""
    path = tmp_path / "se.safetensors"
    save_se(make_se(cartpole), path)
    return path


@pytest.fixture
def small_agent() -> DDQNHyperparameters:
    agent = ddqn(load_recipe("paper", "CartPole-v0"))
    return replace(agent, max_episodes=13, batch_size=16, hidden_size=8, test_episodes=2)


@pytest.fixture
def small_hp(small_agent: DDQNHyperparameters) -> Hyperparameters:
    """An NES run of three members whose evaluations take milliseconds."""
    hp = load_recipe("default", "CartPole-v0")
    return replace(
        hp,
        nes=replace(
            hp.nes,
            population_size=3,
            generations=2,
            centre_agents=3,
            patient_episodes=0,
            start_candidates=1,
            restart_after=0,
            solved_for=0,
            confirming_agents=0,
        ),
        se=replace(hp.se, family="plain", hidden_size=8, activation="lrelu", step_limit=0),
        agents=(small_agent,),
        vary_agent="no",
    )
