"""SEs as gymnasium environments: single (`env`) and vectorised (`vector_env`)."""

import gymnasium

from bilevel.zoo import ENTRIES, env_id, zoo_file

#: Id of the environment for any SE: `gymnasium.make(ENV_ID, path=...)`.
ENV_ID = "bilevel/SyntheticEnv-v0"


def register() -> None:
    """Register ENV_ID and the SEs of the zoo in gymnasium, once."""
    ids: dict[str, dict[str, str]] = {ENV_ID: {}}
    ids |= {env_id(name): {"path": str(zoo_file(name))} for name in ENTRIES}
    for name, kwargs in ids.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="bilevel.gym.env:SyntheticEnv",
                vector_entry_point="bilevel.gym.vector_env:SyntheticVectorEnv",
                kwargs=kwargs,
            )
