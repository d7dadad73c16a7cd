"""Lower bound on the time of one inner-loop step on a core: its matrix products at the core's
measured peak, and its passes over activations, parameters and minibatch at the measured bandwidth
of the cache.

symbol   meaning
------   ----------------------------------------------------------------------
f        multiply-adds of one sample's forward pass through a network
f_1      multiply-adds of its first layer (no gradient of the inputs is needed)
H, B     hidden units of all layers together, batch size
P        parameters
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bilevel.hyperparameters import DDQNHyperparameters, TD3Hyperparameters
from bilevel.kernels.jit import compiled
from bilevel.networks import Network
from bilevel.synthetic_env import Architecture

_FLOAT = 4  # bytes


@dataclass(frozen=True)
class Core:
    """Peak speed of one core of this machine."""

    flops: float  # per second, of a large float32 matrix product
    bandwidth: float  # bytes per second, reading and writing a quarter of a megabyte


@compiled
def _product(a, b, out, repeats):  # type: ignore[no-untyped-def]
    for _ in range(repeats):
        np.dot(a, b, out)


@compiled
def _pass(x, y, repeats):  # type: ignore[no-untyped-def]
    for _ in range(repeats):
        for i in range(x.size):
            y[i] = y[i] + x[i]


def _seconds(function: Callable[..., Any], *arrays: Any, repeats: int) -> float:
    function(*arrays, 1)
    best = float("inf")
    for _ in range(7):
        started = time.perf_counter()
        function(*arrays, repeats)
        best = min(best, (time.perf_counter() - started) / repeats)
    return best


def measure_core() -> Core:
    """Measure peak and bandwidth of the current core."""
    rng = np.random.default_rng(0)
    n = 512
    a, b, out = (rng.normal(0, 1, (n, n)).astype(np.float32) for _ in range(3))
    product = _seconds(_product, a, b, out, repeats=20)
    x, y = (np.zeros(32_768, np.float32) for _ in range(2))
    one_pass = _seconds(_pass, x, y, repeats=2000)
    return Core(2 * n**3 / product, 3 * _FLOAT * x.size / one_pass)


@dataclass
class Work:
    """Accumulated work: multiply-adds, and bytes that passes read and write."""

    multiply_adds: float = 0.0
    bytes: float = 0.0

    def forward(self, net: Network, batch: int) -> None:
        """Add the products, and a pass over every hidden layer."""
        self.multiply_adds += batch * sum(n_in * n_out for n_in, n_out in net.shapes)
        self.bytes += 2 * _FLOAT * batch * _hidden(net)

    def backward(self, net: Network, batch: int, parameters: bool, inputs: bool) -> None:
        """Add gradients of the parameters, the inputs or both."""
        f = sum(n_in * n_out for n_in, n_out in net.shapes)
        first = net.shapes[0][0] * net.shapes[0][1]
        self.multiply_adds += batch * ((f if parameters else 0) + f - (0 if inputs else first))
        self.bytes += 3 * _FLOAT * batch * _hidden(net)

    def update(self, net: Network, target: bool) -> None:
        """Add Adam, which reads four and writes three vectors, and a soft update (two and one)."""
        self.bytes += (7 + (3 if target else 0)) * _FLOAT * net.parameter_count

    def microseconds(self, core: Core) -> float:
        """Lower bound on the time of all work."""
        return 1e6 * (2 * self.multiply_adds / core.flops + self.bytes / core.bandwidth)


def _hidden(net: Network) -> int:
    return int(net.sizes[1:-1].sum())


def step_work(hp: Any, architecture: Architecture) -> Work:
    """Work of one environment step on an SE and one gradient step."""
    n_states, n_actions, batch = architecture.state_size, architecture.n_actions, hp.batch_size
    work = Work()
    for net in architecture.networks:
        work.forward(net, 1)
    if isinstance(hp, DDQNHyperparameters):
        net = hp.network(n_states, n_actions)
        for _ in range(3):  # online and target on the next states, online on the states
            work.forward(net, batch)
        work.backward(net, batch, parameters=True, inputs=False)
        work.update(net, target=True)
        action_size = 1
    else:
        assert isinstance(hp, TD3Hyperparameters)
        actor, critic = hp.networks(n_states, n_actions)
        work.forward(actor, batch)
        for _ in range(2):
            work.forward(critic, batch)
            work.forward(critic, batch)
            work.backward(critic, batch, parameters=True, inputs=False)
            work.update(critic, target=False)
        now_and_then = Work()
        now_and_then.forward(actor, batch)
        now_and_then.forward(critic, batch)
        now_and_then.backward(critic, batch, parameters=False, inputs=True)
        now_and_then.backward(actor, batch, parameters=True, inputs=False)
        now_and_then.update(actor, target=True)
        now_and_then.bytes += 2 * 3 * _FLOAT * critic.parameter_count
        work.multiply_adds += now_and_then.multiply_adds / hp.policy_delay
        work.bytes += now_and_then.bytes / hp.policy_delay
        action_size = n_actions
    work.bytes += 2 * _FLOAT * batch * (2 * n_states + 2 + action_size)  # the minibatch
    return work
