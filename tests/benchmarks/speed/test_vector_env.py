from pathlib import Path

from gymnasium.vector import SyncVectorEnv

from benchmarks.speed.vector_env import BATCHED, LOOPED, copies_of
from bilevel.gym.vector_env import SyntheticVectorEnv


def test_one_column_is_the_compiled_loop_and_the_other_gymnasiums(se_file: Path) -> None:
    for mode, kind in ((BATCHED, SyntheticVectorEnv), (LOOPED, SyncVectorEnv)):
        env = copies_of(se_file, 3, mode)
        assert isinstance(env.unwrapped, kind)
        assert env.num_envs == 3
