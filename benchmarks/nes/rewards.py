"""How much of a task's solution an SE's reward contains, without training and without discounting.

    python -m benchmarks.nes.rewards

If an SE's rewards name the right action in every state, the SE is a policy rather than an
environment: the action with the highest reward then solves the task, and agents learn as much with
a discount of 0. Direct search for a linear policy on the real task is the simplest alternative.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import read_result, write_result
from benchmarks.markdown import mean_and_range, median_and_range, number_and_interval, table
from bilevel.agents.variation import draw_agent
from bilevel.evaluation import train_and_test
from bilevel.evaluation.run import greedy_episodes
from bilevel.kernels import synthetic_env
from bilevel.nes import NES
from bilevel.recipes import load_recipe, usual_agents
from bilevel.synthetic_env import SE, load_se
from bilevel.tasks import ObservationScale, Task, get_task
from bilevel.zoo import ENTRIES, zoo_file
from cluster.show import candidate_actions

#: Test episodes of a policy.
EPISODES = 10
#: Real steps after which direct search gives up.
LIMIT = 1_000_000


def score_of_rewards(task: Task, se: SE, seed: int) -> float:
    """Return the mean return on the real task of the action with the highest reward on the SE."""
    kernel, work, actions = (
        se.kernel,
        synthetic_env.work_space(se.kernel),
        candidate_actions(se.architecture),
    )
    next_states = np.empty((len(actions), task.state_size), np.float32)
    rewards, dones = np.empty((2, len(actions)))

    def highest(state: Any) -> Any:
        states = np.tile(state, (len(actions), 1))
        synthetic_env.step_all(kernel, states, actions, next_states, rewards, dones, work)
        return actions[rewards.argmax()]

    return tested(task, highest, EPISODES, seed)[0]


def steps_of_direct_search(task: Task, scale: ObservationScale, seed: int) -> int:
    """Return the real steps until a random linear policy solves the task; at most LIMIT.

    A policy that solves one episode is tested on EPISODES more. Policies for continuous actions
    read observations in units of their scale, whose measurement is not counted.
    """
    rng, steps = np.random.default_rng(seed), 0
    choose: Any = partial(clipped, scale) if task.continuous else linear
    while steps < LIMIT:
        weights = rng.standard_normal((task.action_size, task.state_size), np.float32)
        for episodes in (1, EPISODES):
            policy = partial(choose, weights)
            score, more = tested(task, policy, episodes, int(rng.integers(2**32)))
            steps += more
            if score < task.solved_reward:
                break
        else:
            return steps
    return LIMIT


def linear(weights: NDArray[np.float32], state: NDArray[np.float32]) -> int:
    """Return the action with the highest linear function of the state."""
    return int(np.argmax(weights @ state))


def clipped(
    scale: ObservationScale, weights: NDArray[np.float32], state: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return linear functions of the scaled state, clipped to [-1, 1]."""
    return (weights @ ((state - scale.mean) / scale.deviation)).clip(-1, 1)


def tested(task: Task, policy: Callable[[Any], Any], episodes: int, seed: int) -> tuple[float, int]:
    """Return the mean return of a policy on the real task, and the steps."""
    transitions = list(greedy_episodes(task, policy, episodes, seed))
    returns = [sum(step.reward for step in episode) for episode in transitions]
    return round(float(np.mean(returns)), 1), sum(map(len, transitions))


def scores_of_agents(task: Task, se: SE, agents: int, discount: float) -> list[float]:
    """Return the scores of narrowed agents (DDQN, or TD3 for continuous actions) with that
    discount, trained on the SE."""
    kinds = usual_agents(task, se.architecture.one_step)
    drawn = (draw_agent(kinds, "narrowed", seed) for seed in range(agents))
    changed = [replace(hp, discount=discount) for hp in drawn]  # type: ignore[call-arg]
    return [train_and_test(task, se, hp, seed).score for seed, hp in enumerate(changed)]


def measured(name: str, ses: int, agents: int) -> dict[str, Any]:
    """Measure random SEs of the recipe `default`, and the SE of the zoo for the same task."""
    learned = load_se(zoo_file(name))
    task = get_task(learned.task_id)
    nes = NES(task, load_recipe("default", task), seed=0)
    start = nes.init()
    distribution = nes.distribution(start)
    random = [score_of_rewards(task, distribution.random(seed), seed) for seed in range(ses)]
    return {
        "random": random,
        "direct": [steps_of_direct_search(task, start.scale, seed) for seed in range(agents)],
        "learned": [score_of_rewards(task, learned.se, seed) for seed in range(agents)],
        "discount 0": scores_of_agents(task, learned.se, agents, 0.0),
        "discount 0.99": scores_of_agents(task, learned.se, agents, 0.99),
    }


def rewards() -> str:
    """Return the table of docs/nes.md."""
    result = read_result("nes_rewards")
    head = ["task", "random SEs whose highest-reward policy solves the task"]
    head += ["SE of the zoo: its highest-reward policy", "agents with discount 0"]
    head += ["agents with discount 0.99", "direct search: real steps to a linear policy"]
    rows = [
        (
            task,
            number_and_interval(
                sum(s >= get_task(task).solved_reward for s in row["random"]), len(row["random"])
            ),
            *(mean_and_range(row[name]) for name in ("learned", "discount 0", "discount 0.99")),
            median_and_range(row["direct"]),
        )
        for task, row in result["tasks"].items()
    ]
    return table(head, rows, result)


def main() -> None:
    """Measure all tasks of the zoo."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ses", type=int, default=1000, help="random SEs per task")
    parser.add_argument("--agents", type=int, default=20, help="on the SE of the zoo")
    options = parser.parse_args()
    command = f"python -m benchmarks.nes.rewards --ses {options.ses} --agents {options.agents}"
    tasks = {name: measured(name, options.ses, options.agents) for name in ENTRIES}
    write_result("nes_rewards", command, {"tasks": tasks})


if __name__ == "__main__":
    main()
