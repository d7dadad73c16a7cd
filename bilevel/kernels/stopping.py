"""Stopping rules of training, compiled: the twins of those in `bilevel.agents.training`."""

from bilevel.kernels.jit import compiled

#: Reasons why training ended; CONVERGED also stands for a solved real task.
CONVERGED, EPISODES_SPENT, NOT_FINITE = 0, 1, 2


@compiled
def converged(returns, episode, init_episodes, window, difference):
    """The rule `returns_converged`; `returns[: episode + 1]` are the returns so far."""
    if episode < init_episodes + window:
        return False
    start = episode + 1 - window
    before = max(start - window, 0)
    recent = returns[start : episode + 1].mean()
    earlier = returns[before:start].mean()
    return abs(recent - earlier) <= difference * abs(earlier)


@compiled
def solved(returns, episode, init_episodes, window, solved_reward):
    """The rule `task_solved`; `returns[: episode + 1]` are the returns so far."""
    if episode < init_episodes or episode + 1 < window:
        return False
    return returns[episode + 1 - window : episode + 1].mean() >= solved_reward
