"""When training on an environment ends (paper, "Heuristics for Agent Training
and Evaluation")."""

from bilevel.kernels.jit import compiled

#: Why training ended.
CONVERGED, EPISODES_SPENT, NOT_FINITE = 0, 1, 2


@compiled
def converged(returns, episode, init_episodes, window, difference):
    """The rule on an SE: the mean return of the last `window` (d) episodes differs
    from that of the d before them by at most `difference` (C_diff), relatively.

    `returns[: episode + 1]` are the returns so far. Checked from episode
    `init_episodes + d` (counted from 0) on; then the earlier window may still be
    short of d episodes, and what there is of it counts.
    """
    if episode < init_episodes + window:
        return False
    start = episode + 1 - window
    before = max(start - window, 0)
    recent = returns[start : episode + 1].mean()
    earlier = returns[before:start].mean()
    return abs(recent - earlier) <= difference * abs(earlier)


@compiled
def solved(returns, episode, init_episodes, window, solved_reward):
    """The rule on the real task: the mean return of the last `window` (d) episodes
    reaches the solved reward, once the initial episodes are over.

    The paper speaks of test episodes here; the authors' code (`env_solved` in
    agents/base_agent.py of automl/learning_environments) takes the training episodes,
    and only that comes near the steps they report. Fewer episodes than d do not count.
    """
    if episode < init_episodes or episode + 1 < window:
        return False
    return returns[episode + 1 - window : episode + 1].mean() >= solved_reward
