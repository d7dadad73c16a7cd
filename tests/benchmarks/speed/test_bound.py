from dataclasses import replace

import pytest

from benchmarks.speed.bound import Core, Work, step_work
from bilevel.hyperparameters import DDQNHyperparameters, Hyperparameters
from bilevel.networks import network
from bilevel.synthetic_env import Architecture
from bilevel.tasks import Task


def test_a_step_of_ddqn_counted_by_hand(
    cartpole: Task, small_hp: Hyperparameters, small_agent: DDQNHyperparameters
) -> None:
    """Inputs 4, two layers of 8 units, outputs 2; a batch of 16."""
    agent = replace(small_agent, hidden_layers=2)
    architecture = Architecture.of(cartpole, small_hp.se)
    of_se = sum(n_in * n_out for net in architecture.networks for n_in, n_out in net.shapes)
    first, whole = 4 * 8, 4 * 8 + 8 * 8 + 8 * 2
    forward, gradients = 3 * whole, whole + (whole - first)
    work = step_work(agent, architecture)
    assert work.multiply_adds == of_se + 16 * (forward + gradients)


def test_time_is_that_of_products_and_passes() -> None:
    work = Work(multiply_adds=500, bytes=3000)
    assert work.microseconds(Core(flops=1e9, bandwidth=1e9)) == pytest.approx(1 + 3)


def test_an_update_passes_over_all_parameters() -> None:
    net, work = network(4, 8, 1, 2, "relu"), Work()
    work.update(net, target=True)
    assert work.bytes == 10 * 4 * (4 * 8 + 8 + 8 * 2 + 2)
