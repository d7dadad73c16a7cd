"""Search spaces of a user's own, from files."""

from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import pytest

from bilevel import InvalidInput
from bilevel.hyperparameters import load_recipe
from bilevel.nes import NES
from bilevel.tasks import get_task
from search_spaces.bohb import search_space
from search_spaces.space import Space

BASE = load_recipe("default", "CartPole-v0")


def written(tmp_path: Path, name: str, *dimensions: CS.hyperparameters.Hyperparameter) -> Path:  # type: ignore[type-arg]
    space, path = CS.ConfigurationSpace(space=list(dimensions)), tmp_path / name
    space.to_json(path) if name.endswith("json") else space.to_yaml(path)
    return path


@pytest.mark.parametrize("name", ["mine.json", "mine.yaml"])
def test_what_configspace_writes_is_read(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name, CS.Float("nes.std_dev", (0.1, 0.4), log=True))
    space = Space.of(str(path))
    space.check(BASE)
    assert space.name == "mine"
    built = space.build()
    assert list(built) == ["nes.std_dev"]
    assert built == Space(space.name, space.content).build()
    one, two = (dict(space.build(seed=3).sample_configuration()) for _ in range(2))
    assert one == two


@pytest.mark.parametrize(
    ("dimension", "told"),
    [
        (CS.Float("nes.sigma", (0.1, 0.4)), "unknown hyperparameter 'nes.sigma': allowed are nes."),
        (CS.Float("td3.learning_rate", (0.1, 0.4)), "td3.learning_rate is of an agent that"),
        (CS.Float("nes.std_dev", (0.1, 99.0)), "std_dev must be float, 1e-06 to 10.0; got"),
        (CS.Float("nes.averaging", (0.0, 1.0)), "averaging must be float, 0.0 to 0.999; got 1.0"),
        (
            CS.Float("nes.std_dev", (0.1, 10.001)),
            "std_dev must be float, 1e-06 to 10.0; got 10.001",
        ),
        (CS.Integer("nes.generations", (1, 9)), "nes.generations is set by the search itself"),
        (CS.Categorical("se.activation", ("tanh", "sine")), "unknown se.activation 'sine'"),
        (CS.OrdinalHyperparameter("se.hidden_size", [8, 16, 32]), "has ordinal hyperparameters"),
    ],
)
def test_a_space_that_does_not_fit_is_told_in_one_line(
    dimension: CS.hyperparameters.Hyperparameter,  # type: ignore[type-arg]
    told: str,
    tmp_path: Path,
) -> None:
    with pytest.raises(InvalidInput) as caught:
        Space.of(str(written(tmp_path, "mine.json", dimension))).check(BASE, ("nes.generations",))
    assert str(caught.value).startswith("search space 'mine'")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_combinations_that_do_not_fit_are_told_with_the_space(tmp_path: Path) -> None:
    """Each value is allowed, but the structure of SEs needs tanh."""
    space = Space.of(str(written(tmp_path, "mine.json", CS.Constant("se.activation", "relu"))))
    task = get_task("CartPole-v0")
    space.check(BASE)
    with pytest.raises(InvalidInput, match=r"^search space 'mine': se.structure .* tanh"):
        space.check(BASE, fits=lambda hp: NES(task, hp))


def test_a_space_of_the_package_may_not_fit_the_recipe() -> None:
    full, hp = Space.of("full"), load_recipe("paper", "CartPole-v0", agents=("ddqn", "td3"))
    full.check(hp)
    short = tuple(replace(agent, max_episodes=21) for agent in hp.agents)
    full.check(replace(hp, agents=short))
    short = (short[0], replace(short[1], max_episodes=20))
    with pytest.raises(InvalidInput, match=r"'full': td3\.init_episodes must be below td3\."):
        full.check(replace(hp, agents=short))


def test_what_a_space_searches() -> None:
    core = Space.of("core").searched()
    assert {"nes.averaging", "se.spread"} < core  # the former as one minus it
    assert core.isdisjoint({"nes.1-averaging", "nes.update", "ddqn.discount"})
    assert "td3.discount" in Space.of("full").searched(("td3",))


def test_a_value_is_read_where_a_condition_leaves_a_dimension_out(tmp_path: Path) -> None:
    space = CS.ConfigurationSpace(
        space=[CS.Categorical("nes.ties", ("mean", "order")), CS.Float("nes.std_dev", (0.1, 0.4))]
    )
    space.add(CS.EqualsCondition(space["nes.std_dev"], space["nes.ties"], "mean"))
    space.to_json(tmp_path / "mine.json")
    mine = Space.of(str(tmp_path / "mine.json"))
    assert mine.searched() == {"nes.ties"}


def test_a_hyperparameter_may_not_be_set_twice(tmp_path: Path) -> None:
    both = CS.Float("nes.averaging", (0.1, 0.9)), CS.Float("nes.1-averaging", (0.1, 0.9))
    with pytest.raises(InvalidInput, match=r"'mine': hyperparameter nes.averaging is set twice"):
        Space.of(str(written(tmp_path, "mine.json", *both))).check(BASE)


def test_values_that_the_space_forbids_are_not_tried(tmp_path: Path) -> None:
    space = CS.ConfigurationSpace(space=[CS.Integer("nes.population_size", (0, 3))])
    space.add(CS.ForbiddenEqualsClause(space["nes.population_size"], 0))
    space.to_json(tmp_path / "mine.json")
    Space.of(str(tmp_path / "mine.json")).check(BASE)


def test_an_infinite_range_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, "mine.json", CS.Float("nes.std_dev", (0.1, 0.4)))
    path.write_text(path.read_text().replace("0.4", "Infinity"))
    with pytest.raises(
        InvalidInput, match=r"^search space 'mine': nes.std_dev must have finite ends"
    ):
        Space.of(str(path))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        "nonsense: [",
        '{"hyperparameters": [{}]}',
        "[" * 9999,
        "meta: {begun: 2026-01-01}\nhyperparameters: []\n",  # a date is no JSON
    ],
    ids=range(7),
)
@pytest.mark.parametrize("ending", ["json", "yaml"])
def test_files_that_are_no_spaces_are_told_in_one_line(
    text: str, ending: str, tmp_path: Path
) -> None:
    path = tmp_path / f"mine.{ending}"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=r"^search space [^\n]+$"):
        Space.of(str(path))


def test_the_packages_own_spaces_fit_any_agent() -> None:
    assert Space.of("core").build(("td3",)) == search_space("core", ("td3",))
    with pytest.raises(InvalidInput, match="unknown search space 'x': allowed are full, core"):
        Space.of("x")


def test_a_space_of_the_package_fits_a_task_with_many_observations() -> None:
    core = Space.of("core")
    assert core.fitting("se.hidden_size", 12) is core
    for least, ends in ((16, (16, 64)), (80, (80, 160))):
        fitted = core.fitting("se.hidden_size", least)
        units = fitted.build()["se.hidden_size"]
        assert isinstance(units, CS.UniformIntegerHyperparameter)
        assert (units.lower, units.upper, units.log) == (*ends, True)
        assert fitted.name == "core"
        others = [dict(space.build()) for space in (core, fitted)]
        assert all(other.pop("se.hidden_size") for other in others)
        assert others[0] == others[1]


def test_a_space_of_the_users_own_stays_as_it_is(tmp_path: Path) -> None:
    mine = Space.of(str(written(tmp_path, "mine.json", CS.Integer("se.hidden_size", (4, 8)))))
    assert mine.fitting("se.hidden_size", 16) is mine
