"""Compile all kernels once, into the disk cache: `python -m bilevel.kernels.compile`."""

from dataclasses import replace

from bilevel.agents import get_agent, registered_agents
from bilevel.evaluation import EvaluationRequest, evaluate, train_and_test
from bilevel.hyperparameters import load_preset
from bilevel.synthetic_env import Architecture
from bilevel.synthetic_env.fitted import fitted_psi
from bilevel.tasks import get_task


def main() -> None:
    """Run the smallest evaluation of every agent that goes through every kernel, and a fit."""
    task = get_task("CartPole-v0")
    for name in registered_agents():
        if get_agent(name).build_kernel is None:
            continue
        hp = load_preset("default", task.id, agents=(name,))
        agent = replace(hp.agents[0], max_episodes=2, init_episodes=0, test_episodes=1)
        request = EvaluationRequest(0, 0, agent, start_seed=0)
        evaluate(task, Architecture.of(task, hp.se), None, request)
        train_and_test(task, None, agent, 0)
    fitted_psi(task, Architecture.of(task, load_preset("default", task.id).se), 0)


if __name__ == "__main__":
    main()
