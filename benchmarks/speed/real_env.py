"""Steps per second of tests on MuJoCo tasks: EvaluateAgent and a plain loop.

    python -m benchmarks.speed.real_env

Both run the same episodes of the same environment with the same compiled actor, alternately on one
core. The plain loop only casts observations, scales actions and adds rewards.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.machine import read_result, spread, write_result
from benchmarks.markdown import rate_rows, table
from bilevel.agents import get_agent
from bilevel.evaluation.run import greedy_episodes
from bilevel.hyperparameters import TD3Hyperparameters
from bilevel.kernels import training
from bilevel.tasks import Task, get_task

TASKS = {"HalfCheetah-v5": 3000.0, "Hopper-v5": 2000.0, "Swimmer-v5": 330.0}
EPISODES, REPEATS = 4, 15


def plain(env: Any, greedy: Callable[[Any], Any]) -> int:
    """Run episodes in a plain loop; return the steps."""
    high, steps, total = env.action_space.high, 0, 0.0
    for episode in range(EPISODES):
        observation, over = env.reset(seed=episode)[0], False
        while not over:
            action = high * greedy(observation.astype(np.float32))
            observation, reward, terminated, truncated, _ = env.step(action)
            total, steps, over = total + reward, steps + 1, terminated or truncated
    return steps


def tests(task: Task, greedy: Callable[[Any], Any]) -> int:
    """Run episodes as the tests of agents do; return the steps."""
    steps = 0
    for transitions in greedy_episodes(task, greedy, EPISODES, seed=0):
        steps += len(transitions)
        sum(transition.reward for transition in transitions)
    return steps


def rate(run: Callable[[], int]) -> float:
    """Return steps per core second."""
    started = time.process_time()
    steps = run()
    return steps / (time.process_time() - started)


def real_env() -> str:
    """Return the table."""
    result = read_result("real_env")
    head = "task", "steps per second in tests", "in a plain loop", "ratio"
    return table(head, rate_rows(result["rates"], ("tests", "plain"), ".2f"), result)


def main() -> None:
    """Measure and write `results/real_env.json`."""
    rows = {}
    for name, solved_reward in TASKS.items():
        task = get_task(name, solved_reward)
        build = get_agent("td3", continuous=True).build_kernel
        assert build is not None
        rng = np.random.default_rng(0)
        agent = build(TD3Hyperparameters(), task.state_size, task.action_size, rng)
        greedy = partial(training.greedy_action, agent)
        ours, theirs = partial(tests, task, greedy), partial(plain, task.make(), greedy)
        rate(ours), rate(theirs)  # loads the kernels
        pairs = [(rate(ours), rate(theirs)) for _ in range(REPEATS)]
        rows[name] = {
            "tests": spread([mine for mine, _ in pairs]),
            "plain": spread([other for _, other in pairs]),
            "ratio": spread([mine / other for mine, other in pairs]),
        }
        print(name, rows[name], flush=True)
    command = "python -m benchmarks.speed.real_env"
    write_result("real_env", command, {"repeats": REPEATS, "rates": rows})


if __name__ == "__main__":
    main()
