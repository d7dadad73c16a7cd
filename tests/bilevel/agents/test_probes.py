"""Every built-in agent, definition and compiled twin, solves SEs with known action values.

Each probe has one cause of failure (after `tests/environments.py` of rejax). The state is a number
s in [-1, 1], there are two actions, and the SE's networks represent the probe exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
import torch

from bilevel.agents import get_agent
from bilevel.agents.agent import RegisteredAgent, agent_seeds
from bilevel.agents.environments import KernelEnvironment, compiled_environment
from bilevel.agents.modules import set_parameters
from bilevel.agents.training import returns_converged
from bilevel.agents.training import train as train_in_python
from bilevel.evaluation.run import schedule
from bilevel.hyperparameters import default_agents
from bilevel.kernels import training
from bilevel.kernels.dynamics import CARTPOLE, OBSERVED
from bilevel.kernels.environment import Environment
from bilevel.synthetic_env import SE, Architecture
from bilevel.tasks import Task

#: Hidden ReLU units, given (action 0, action 1, s): s and -s where positive, once for each action,
#: and the actions.
HIDDEN = [[-1, 0, 1], [-1, 0, -1], [0, -1, 1], [0, -1, -1], [1, 0, 0], [0, 1, 0]]
STATE = (1, -1, 1, -1, 0, 0)  # s
SIGNED_STATE = (1, -1, -1, 1, 0, 0)  # s for action 1, -s for action 0
SIGN = (0, 0, 0, 0, -1, 1)  # 1 for action 1, -1 for action 0
ZERO = (0,) * 6

EPISODES, DISCOUNT, TOLERANCE = 250, 0.9, 0.2


@dataclass(frozen=True)
class Probe:
    """An SE by the output weights and bias of its networks, and its action values."""

    values: dict[tuple[float, int], float]  # by state and action
    initial_states: Sequence[float] = (0.0,)
    next_state: tuple[Sequence[int], float] = (ZERO, 0.0)
    reward: tuple[Sequence[int], float] = (ZERO, 0.0)
    done: tuple[Sequence[int], float] = (ZERO, 1.0)

    @property
    def environment(self) -> Environment:
        """The SE in the form of the kernels."""
        layer = np.concatenate([np.ravel(HIDDEN), np.zeros(6)])
        outputs = (self.next_state, self.reward, self.done)
        psi = np.concatenate(
            [np.concatenate([layer, np.atleast_1d(o[0]), np.atleast_1d(o[1])]) for o in outputs]
        )
        se = SE(Architecture(1, 2, 1, 6, "relu", step_limit=2), psi.astype(np.float32))
        task = Task("probe", 1, 2, 2, 0.0, 0.0, CARTPOLE)
        env = compiled_environment(task, se, episodes=1, seed=0)
        states = np.array(self.initial_states).reshape(-1, 1)
        return env._replace(dynamics=OBSERVED, initial_physics=states, physics=np.zeros(1))


PROBES = {
    "reward": Probe({(0, 0): 1, (0, 1): 1}, reward=(ZERO, 1.0)),
    "state-dependent reward": Probe(
        {(-1, 0): -1, (-1, 1): -1, (1, 0): 1, (1, 1): 1},
        initial_states=(-1.0, 1.0),
        reward=(STATE, 0.0),
    ),
    "discounted delayed reward": Probe(
        {(0, 0): DISCOUNT, (0, 1): DISCOUNT, (1, 0): 1, (1, 1): 1},
        next_state=(ZERO, 1.0),
        reward=(STATE, 0.0),
        done=(STATE, 0.0),
    ),
    "action-dependent reward": Probe({(0, 0): -1, (0, 1): 1}, reward=(SIGN, 0.0)),
    "action- and state-dependent reward": Probe(
        {(-1, 0): 1, (-1, 1): -1, (1, 0): -1, (1, 1): 1},
        initial_states=(-1.0, 1.0),
        reward=(SIGNED_STATE, 0.0),
    ),
}


def hyperparameters(name: str) -> Any:
    (hp,) = default_agents((name,))
    known = {field.name for field in fields(hp)}
    changes: dict[str, Any] = {
        "max_episodes": EPISODES,
        "init_episodes": 100,
        "early_out_episodes": EPISODES,
        "batch_size": 32,
        "hidden_size": 32,
        "hidden_layers": 1,
        "activation": "tanh",
        "learning_rate": 0.01,
        "target_update_rate": 0.1,
        "discount": DISCOUNT,
        "initial_epsilon": 1.0,
        "minimal_epsilon": 1.0,
    }
    if name == "ppo":
        rollouts = {"init_episodes": 0, "rollout_steps": 64, "max_episodes": 1200}
        changes |= {**rollouts, "early_out_episodes": 1200}
    return replace(hp, **{field: v for field, v in changes.items() if field in known})


def value(definition: Any, parameters: Sequence[Any], state: float, action: int) -> float:
    """An action value by the networks of a definition with these parameters."""
    with torch.no_grad():
        if hasattr(definition, "online"):
            set_parameters(definition.online, parameters[0])
            return float(definition.values(definition.online, torch.tensor([state]))[action])
        set_parameters(definition.critics[0], parameters[2])
        one_hot = [float(action == 0), float(action == 1)]
        return float(definition.critics[0](torch.tensor([state, *one_hot])))


def trained(registered: RegisteredAgent, hp: Any, env: Environment, compiled: bool) -> Any:
    """Return the agent's definition or compiled twin after training on a probe."""
    sizes = env.state_size, env.se.action_weights.shape[0]
    if compiled:
        assert registered.build_kernel is not None
        initial, loop = agent_seeds(0)
        kernel = registered.build_kernel(hp, *sizes, np.random.default_rng(initial))
        training.train(kernel, env, schedule(hp), np.array([loop], np.uint64))
        return kernel
    definition = registered.build(hp, *sizes, 0)
    in_python = KernelEnvironment(env, sizes[1], registered.continuous)
    train_in_python(definition, hp, in_python, returns_converged(hp))
    return definition


@pytest.mark.parametrize("compiled", [False, True], ids=["definition", "compiled"])
@pytest.mark.parametrize("probe", PROBES)
@pytest.mark.parametrize("name", ["ddqn", "dueling-ddqn", "td3"])
def test_agents_learn_the_action_values_of_probes(name: str, probe: str, compiled: bool) -> None:
    hp, env = hyperparameters(name), PROBES[probe].environment
    agent = trained(get_agent(name), hp, env, compiled)
    definition = agent if not compiled else get_agent(name).build(hp, 1, 2, 0)
    parameters = agent.parameters()
    values = PROBES[probe].values
    for (state, action), expected in values.items():
        learned = value(definition, parameters, float(state), action)
        assert learned == pytest.approx(expected, abs=TOLERANCE), (state, action)
    for state in {state for state, _ in values}:
        at = np.array([state], np.float32)
        action = training.greedy_action(agent, at) if compiled else agent.greedy(at)
        assert values[state, action] == max(values[state, 0], values[state, 1])


@pytest.mark.parametrize("compiled", [False, True], ids=["definition", "compiled"])
@pytest.mark.parametrize("probe", PROBES)
def test_ppo_learns_the_values_of_the_best_actions(probe: str, compiled: bool) -> None:
    agent = trained(get_agent("ppo"), hyperparameters("ppo"), PROBES[probe].environment, compiled)
    definition: Any = get_agent("ppo").build(hyperparameters("ppo"), 1, 2, 0)
    set_parameters(definition.value, agent.parameters()[1])
    values = PROBES[probe].values
    for state in {state for state, _ in values}:
        best, at = max(values[state, 0], values[state, 1]), np.array([state], np.float32)
        learned = definition.value(torch.from_numpy(at)).item()
        assert learned == pytest.approx(best, abs=TOLERANCE)
        action = training.greedy_action(agent, at) if compiled else agent.greedy(at)
        assert values[state, action] == best


@pytest.mark.parametrize("compiled", [False, True], ids=["definition", "compiled"])
@pytest.mark.parametrize("name", ["td3", "ppo"])
def test_agents_with_continuous_actions_learn_a_probe(name: str, compiled: bool) -> None:
    """The reward of action a in state s, which is -1 or 1, is -|a - s / 2|."""
    hp = replace(hyperparameters(name), max_episodes=1500, learning_rate=0.005)
    if name == "td3":
        hp = replace(hp, action_noise=0.3)
    architecture = Architecture(1, 1, 1, 2, "relu", 1, continuous=True)
    psi = np.zeros(architecture.parameter_count, np.float32)
    tensors = architecture.tensors(psi)
    tensors["reward.0.weight"][...] = [[1, -0.5], [-1, 0.5]]
    tensors["reward.1.weight"][...] = -1
    tensors["done.1.bias"][...] = 1
    se = SE(architecture, psi)
    task = Task("probe", 1, 1, 2, 0.0, 0.0, CARTPOLE, continuous=True)
    env = compiled_environment(task, se, episodes=1, seed=0)
    states = np.array([[-1.0], [1.0]])
    env = env._replace(dynamics=OBSERVED, initial_physics=states, physics=np.zeros(1))
    agent = trained(get_agent(name, continuous=True), hp, env, compiled)
    for state in (-1.0, 1.0):
        at = np.array([state], np.float32)
        action = training.greedy_action(agent, at) if compiled else agent.greedy(at)
        assert action == pytest.approx(state / 2, abs=TOLERANCE)
