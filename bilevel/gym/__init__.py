"""SEs as gymnasium environments: one (`env`), many copies that step together (`vector_env`)."""

from pathlib import Path

import gymnasium

#: Id of the environment that takes any SE: `gymnasium.make(ENV_ID, path=...)`.
ENV_ID = "bilevel/SyntheticEnv-v0"


def register(env_id: str = ENV_ID, path: Path | None = None) -> None:
    """Register an id in gymnasium, once; with `path`, that of one SE file."""
    if env_id not in gymnasium.registry:
        gymnasium.register(
            env_id,
            entry_point="bilevel.gym.env:SyntheticEnv",
            vector_entry_point="bilevel.gym.vector_env:SyntheticVectorEnv",
            kwargs={} if path is None else {"path": str(path)},
        )
