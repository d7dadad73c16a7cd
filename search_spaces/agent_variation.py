"""The ranges from which agent hyperparameters are drawn when they are varied
(paper, Table "Ranges used for sampling random agent HP config.")."""

from dataclasses import replace

import ConfigSpace as CS

from bilevel.hyperparameters import DDQNHyperparameters


def agent_variation_space(seed: int | None = None) -> CS.ConfigurationSpace:
    """Learning rate, batch size, hidden size (log scale) and hidden layers."""
    return CS.ConfigurationSpace(
        name="agent-variation",
        seed=seed,
        space=[
            CS.Float("learning_rate", (1e-3 / 3, 1e-3 * 3), log=True),
            CS.Integer("batch_size", (42, 384), log=True),
            CS.Integer("hidden_size", (42, 384), log=True),
            CS.Integer("hidden_layers", (1, 3)),
        ],
    )


def vary_agent(agent: DDQNHyperparameters, seed: int) -> DDQNHyperparameters:
    """`agent` with the varied hyperparameters drawn anew, by `seed` alone."""
    drawn = agent_variation_space(seed % 2**32).sample_configuration()
    return replace(
        agent,
        learning_rate=float(drawn["learning_rate"]),
        batch_size=int(drawn["batch_size"]),
        hidden_size=int(drawn["hidden_size"]),
        hidden_layers=int(drawn["hidden_layers"]),
    )
