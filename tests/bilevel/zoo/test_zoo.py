"""The SEs of the zoo and their cards."""

from hashlib import sha256

import gymnasium
import numpy as np
import pytest
import torch

import bilevel
from bilevel import InvalidInput
from bilevel.agents.variation import draw_agent
from bilevel.evaluation import train_and_test
from bilevel.recipes import load_recipe, usual_agents
from bilevel.seeds import Purpose, derive
from bilevel.synthetic_env import load_se
from bilevel.tasks import get_task
from bilevel.zoo import ENTRIES, card, env_id, get_entry, zoo_file
from tests.documents import documented_code


@pytest.mark.parametrize("name", ENTRIES)
def test_entry_card_and_file_agree(name: str) -> None:
    entry, found, se = get_entry(name), card(name), load_se(zoo_file(name))
    assert sha256(zoo_file(name).read_bytes()).hexdigest() == found.sha256
    expected = entry.name, entry.task, entry.recipe, entry.seed
    assert (found.name, found.task, found.recipe, found.seed) == expected
    assert (se.task_id, se.info["seed"], se.info["confirmed"]) == (entry.task, entry.seed, True)
    assert se.info["bilevel_version"] == found.version
    assert se.info["real_env_steps"] == found.real_env_steps
    task = get_task(entry.task)
    assert se.info["hyperparameters"] == load_recipe(entry.recipe, task).to_dict()
    kinds = {"td3"} if task.continuous else {"ddqn", "dueling-ddqn", "td3"}
    assert {scores.agent for scores in found.scores} == kinds
    assert all(scores.agents >= 50 for scores in found.scores)


@pytest.mark.parametrize(("name", "lowest"), [("CartPole-v0", 150.0), ("Acrobot-v1", -150.0)])
def test_fresh_agents_learn_the_real_task(name: str, lowest: float) -> None:
    """The bounds leave room for differences between processors."""
    se = load_se(zoo_file(name))
    agents, scores = usual_agents(se.task(), se.se.architecture.one_step, ("ddqn",)), []
    for number in range(4):
        seed = derive(5, Purpose.EVALUATION, number)
        agent = draw_agent(agents, "small", seed)
        scores.append(train_and_test(se.task(), se.se, agent, seed).score)
    assert np.median(scores) > lowest


@pytest.mark.parametrize("name", ENTRIES)
def test_ses_are_loaded_by_name(name: str) -> None:
    assert bilevel.load(name) == load_se(zoo_file(name))
    env = gymnasium.make(env_id(name))
    assert env.spec is not None
    assert env.spec.kwargs == {"path": str(zoo_file(name))}
    many = gymnasium.make_vec(env_id(name), num_envs=3)
    assert many.reset(seed=0)[0].shape == (3, get_task(get_entry(name).task).state_size)


def test_unknown_names() -> None:
    with pytest.raises(InvalidInput, match=r"no SE file at 'CartPole-v9': .* or a name of the zoo"):
        bilevel.load("CartPole-v9")


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
def test_the_documented_example_with_stable_baselines3() -> None:
    torch.set_num_threads(1)  # other tests run at the same time
    code: dict[str, float] = {}
    exec(documented_code("zoo.md"), code)
    assert code["score"] > 100  # random actions: about 20
