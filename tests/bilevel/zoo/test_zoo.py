"""The zoo's files and cards agree, and its SEs teach."""

from hashlib import sha256

import gymnasium
import numpy as np
import pytest
import torch

import bilevel
from bilevel import InvalidInput
from bilevel.agents.variation import draw_agent
from bilevel.evaluation import train_and_test
from bilevel.hyperparameters import default_agents, load_recipe
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from bilevel.zoo import ENTRIES, card, env_id, get_entry, zoo_file
from tests.documents import documented_code


@pytest.mark.parametrize("name", ENTRIES)
def test_card_file_and_entry_agree(name: str) -> None:
    entry, told, se = get_entry(name), card(name), load_se(zoo_file(name))
    assert sha256(zoo_file(name).read_bytes()).hexdigest() == told.sha256
    assert load_se(zoo_file(name)).info["confirmed"]
    assert (told.name, told.task, told.recipe, told.seed) == (
        entry.name,
        entry.task,
        entry.recipe,
        entry.seed,
    )
    assert se.task_id == entry.task
    assert se.info["seed"] == entry.seed
    assert se.info["bilevel_version"] == told.version
    assert se.info["real_env_steps"] == told.real_env_steps
    hp = load_recipe(entry.recipe, entry.task).to_dict()
    assert se.info["hyperparameters"] == hp  # of today's recipe
    assert {taught.agent for taught in told.taught} == {"ddqn", "dueling-ddqn", "td3"}
    assert all(taught.agents >= 50 for taught in told.taught)


@pytest.mark.parametrize(("name", "least"), [("CartPole-v0", 150.0), ("Acrobot-v1", -150.0)])
def test_fresh_agents_do_about_as_well_as_the_card_says(name: str, least: float) -> None:
    """The bounds leave room for the luck of a few agents on other processors."""
    se = load_se(zoo_file(name))
    kinds = default_agents(("ddqn",))
    scores = []
    for number in range(4):
        word = derive(5, Purpose.EVALUATION, number)
        agent = draw_agent(kinds, "small", word)
        scores.append(train_and_test(se.task(), se.se, agent, word).score)
    assert np.median(scores) > least


def test_names_are_read_and_others_told() -> None:
    for name in ENTRIES:
        np.testing.assert_array_equal(bilevel.load(name).psi, load_se(zoo_file(name)).psi)
    with pytest.raises(InvalidInput, match=r"no SE file at 'CartPole-v9': .* or a name of the zoo"):
        bilevel.load("CartPole-v9")
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(InvalidInput, match="path is missing: a file"):
            make("bilevel/SyntheticEnv-v0")


def test_an_id_for_each() -> None:
    for name in ENTRIES:
        env = gymnasium.make(env_id(name))
        assert env.spec is not None
        assert env.spec.kwargs == {"path": str(zoo_file(name))}
        assert str(zoo_file(name)) in env.spec.to_json()
        many = gymnasium.make_vec(env_id(name), num_envs=3)
        assert many.reset(seed=0)[0].shape == (3, get_task(get_entry(name).task).state_size)
    with pytest.raises(InvalidInput, match=r"unknown SE of the zoo 'Pong': allowed are CartPole"):
        zoo_file("Pong")


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_the_documented_example_with_stable_baselines3() -> None:
    """An agent of another project learns the real task from the SE alone."""
    torch.set_num_threads(1)  # other tests run beside this one
    code: dict[str, float] = {}
    exec(documented_code("zoo.md"), code)
    assert code["score"] > 100  # at random: about 20
