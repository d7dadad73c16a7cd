"""What a study is, what it may begin with, and what it hands over."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import ConfigSpace as CS
import pytest

from bilevel import InvalidInput
from bilevel.hyperparameters import load_recipe
from bilevel.tasks import get_task
from cluster.bohb.search.bracket_search import BracketSearch, Job
from cluster.bohb.study.brackets import Schedule
from cluster.bohb.study.definition import RECIPE_FILE, SPACE_FILE, Study
from cluster.bohb.study.journal import Journal, Origin
from cluster.bohb.study.profiles import METHODS, get_profile, sized
from cluster.bohb.view import study_progress
from cluster.cli.options import RunOptions
from cluster.storage.run_folder import locked_settings
from search_spaces.bohb import search_space
from search_spaces.space import Space
from tests.commands import run_bilevel
from tests.searches import LADDER, run_to_end
from tests.studies import make_study, new_study, run_job


def test_a_configuration_is_handed_over_as_the_recipe_that_its_runs_had(tmp_path: Path) -> None:
    make_study(tmp_path / "study")
    study, line = new_study(tmp_path / "study"), Journal(tmp_path / "study").configs[0]
    path = tmp_path / "found.toml"
    path.write_text(study.recipe_text(line.id, line.configuration))
    found = load_recipe(str(path), study.task)
    assert replace(found, recipe="default") == study.run(line.id, line.configuration, 0).hp
    assert found.nes.solved_for > 0


def test_the_name_of_a_study_stands_for_its_recipe(tmp_path: Path) -> None:
    made = make_study(tmp_path / "CartPole-v0" / "mine")
    line = Journal(made.folder).configs[-1]
    (made.folder / RECIPE_FILE).write_text(made.recipe_text(line.id, line.configuration))
    options = RunOptions(
        "CartPole-v0", 0, None, (), None, None, tmp_path, None, None, recipe="mine"
    )
    hp = options.the_hyperparameters(made.task)
    assert hp.recipe == "mine"
    assert replace(hp, recipe="default") == made.run(line.id, line.configuration, 0).hp
    larger = replace(options, population=77).the_hyperparameters(made.task)
    assert larger.nes == replace(hp.nes, population_size=77)


def test_a_study_without_an_incumbent_has_no_recipe(tmp_path: Path) -> None:
    make_study(tmp_path / "CartPole-v0" / "mine")
    arguments = ("nes", "CartPole-v0", "--recipe", "mine", "--home", str(tmp_path))
    result = run_bilevel(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert (
        "'mine' on CartPole-v0 has found no recipe: give a study that has run to its end"
        in result.stderr
    )


def test_an_unknown_recipe_is_answered_with_those_that_studies_have_found(tmp_path: Path) -> None:
    make_study(tmp_path / "CartPole-v0" / "mine")
    make_study(tmp_path / "CartPole-v0" / "found")
    (tmp_path / "CartPole-v0" / "found" / RECIPE_FILE).touch()
    arguments = ("--recipe", "x", "--home", str(tmp_path))
    result = run_bilevel("nes", "CartPole-v0", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert "studies on CartPole-v0 that have found one (found)" in " ".join(result.stderr.split())
    result = run_bilevel("bohb", "Acrobot-v1", *arguments, cwd=tmp_path)
    assert "studies on Acrobot-v1 that have found one (none yet)" in " ".join(result.stderr.split())


def test_a_study_keeps_the_ranges_that_it_was_begun_with(tmp_path: Path) -> None:
    """A later version's space of the same name may have others."""
    study = make_study(tmp_path)
    study.write_space()
    study.write_space()  # by the same version
    other = search_space("core").to_serialized_dict()
    other["hyperparameters"][0]["upper"] *= 2
    (tmp_path / SPACE_FILE).write_text(json.dumps(other))
    with pytest.raises(InvalidInput, match="begun with other ranges of the search space 'core'"):
        study.write_space()
    assert json.loads((tmp_path / SPACE_FILE).read_text()) == other


def test_a_recipe_outside_of_the_space_is_moved_and_told() -> None:
    task = get_task("CartPole-v0")
    recipe = load_recipe("default", task.id)
    inside = replace(new_study(Path("study")), prior="recipe", base=recipe)
    assert inside.moved == {}
    assert inside.prior_configuration is not None
    paper = replace(inside, base=load_recipe("paper", task.id))
    assert paper.moved["nes.std_dev"] == (0.0124, 0.03)
    # 0 stands for the task's own limit, which is in the space.
    assert "se.step_limit" not in paper.moved
    assert paper.prior_configuration is not None
    assert paper.prior_configuration["se.step_limit"] == task.step_limit
    assert replace(paper, prior="none").moved == {}


def test_a_recipe_that_the_space_forbids_is_told_before_the_search(tmp_path: Path) -> None:
    study = new_study(tmp_path / "study")
    dimension, base = CS.Integer("nes.population_size", (2, 48)), study.base.nes.population_size
    space = CS.ConfigurationSpace(space=[dimension])
    space.add(CS.ForbiddenEqualsClause(dimension, base))
    space.to_json(tmp_path / "mine.json")
    mine = replace(study, space=Space.of(str(tmp_path / "mine.json")))
    mine.check_prior()
    with pytest.raises(
        InvalidInput, match=r"would begin with its recipe \(not with --prior none\)"
    ):
        replace(mine, prior="recipe").check_prior()


def test_progress_of_a_study_whose_agent_is_not_known_here(tmp_path: Path) -> None:
    make_study(tmp_path)
    settings = json.loads((tmp_path / "settings.json").read_text())
    settings["base"]["agents"] = {"of-another-file": {}}
    (tmp_path / "settings.json").write_text(json.dumps(settings))
    with pytest.raises(InvalidInput, match="unknown agent 'of-another-file'"):
        Study.read(tmp_path)
    assert study_progress(tmp_path, 2).done == "6/6 results"


@pytest.fixture
def study(tmp_path: Path) -> Study:
    task = get_task("CartPole-v0")
    base = sized(load_recipe("default", task.id), get_profile("local"))
    schedule = Schedule((1, 3), 2)
    study = Study(tmp_path / "study", task, 3, Space("core"), schedule, base, "hyperband")
    with locked_settings(study.folder, study.settings()):
        return study


def test_a_study_is_what_its_folder_says(study: Study) -> None:
    assert Study.read(study.folder) == study


@pytest.mark.parametrize("method", METHODS)
def test_bohb_alone_asks_the_model(method: str, study: Study, tmp_path: Path) -> None:
    study = replace(study, method=method)
    jobs = run_to_end(BracketSearch.of(study, Journal(tmp_path), 12))
    assert any(job.origin is Origin.MODEL for job in jobs) == (method == "bohb")


def test_starts_are_each_runs_own(study: Study) -> None:
    """Starts depend on the study's seed, the configuration's id and the number of the run."""
    runs = [study.run((0, 0, of), {}, number) for of in range(3) for number in range(2)]
    assert len({run.seed for run in runs}) == 6
    assert study.run((0, 0, 1), {"se.hidden_size": 16}, 0).seed == runs[2].seed
    assert replace(study, seed=4).run((0, 0, 1), {}, 0).seed != runs[2].seed


def test_a_configuration_changes_what_it_names(study: Study) -> None:
    hp = study.run((0, 0, 0), {"se.hidden_size": 16, "nes.population_size": 9}, 0).hp
    assert (hp.se.hidden_size, hp.nes.population_size) == (16, 9)
    assert replace(hp, se=study.base.se, nes=study.base.nes) == study.base
    assert replace(hp.nes, population_size=study.base.nes.population_size) == study.base.nes


def test_steps_on_the_real_task_are_counted_through(study: Study) -> None:
    """The count includes the scale of observations and the choice of a start."""
    job = Job((0, 0, 0), {"nes.population_size": 2}, 3, Origin.RANDOM, 0.0)
    run_job(study, job)
    run = study.run(job.id, job.configuration, 0)
    state, begun = run.load(), run.nes.init()
    assert state is not None
    assert begun.race is not None
    before = begun.real_env_steps + 40 * begun.race.evaluations
    evaluations = run.hp.nes.evaluations
    counted = [record.real_env_steps for record in state.records]
    assert len(counted) > 3
    assert counted == [before + 40 * evaluations * (n + 1) for n in range(len(counted))]


@pytest.fixture(scope="module")
def earlier_study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A study of which the model can learn."""
    return make_study(tmp_path_factory.mktemp("study") / "earlier-one", brackets=12)


@pytest.fixture
def later(earlier_study: Study, tmp_path: Path) -> Study:
    shutil.copytree(earlier_study.folder, tmp_path / "earlier-one")
    return replace(
        earlier_study, folder=tmp_path / "later", prior="earlier-one", seed=5, schedule=LADDER
    )


def test_earlier_results_are_copied_before_their_configurations(
    later: Study, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other study may be under way: a result needs its configuration."""
    copied: list[str] = []
    monkeypatch.setattr(
        "cluster.bohb.study.definition.write_aside", lambda path, _: copied.append(path.name)
    )
    with pytest.raises(FileNotFoundError):  # nothing was written
        later.take_over_prior()
    assert copied == ["results.json", "configs.json"]


def test_earlier_results_are_copied(later: Study) -> None:
    """What becomes of the other study does not matter then."""
    later.check_prior()
    later.take_over_prior()
    assert later.earlier is not None
    other = later.folder.parent / later.prior
    assert later.earlier.results == Journal(other).results
    shutil.rmtree(other)
    later.check_prior()
    later.take_over_prior()
    search = BracketSearch.of(later, Journal(later.folder), 1)
    found = [search.next_job() for _ in range(9)]
    assert any(job is not None and job.origin is Origin.MODEL for job in found)


def test_a_study_with_the_seed_of_its_prior_does_not_repeat_it(later: Study) -> None:
    other = Study.read(later.folder.parent / later.prior)
    same = replace(later, seed=other.seed, schedule=other.schedule)
    same.take_over_prior()
    theirs = {json.dumps(line.configuration) for line in Journal(other.folder).configs}
    search = BracketSearch.of(same, Journal(same.folder), 6)
    drawn = [job for job in (search.next_job() for _ in range(18)) if job is not None]
    assert {job.origin for job in drawn} >= {Origin.RANDOM}
    assert not theirs & {json.dumps(job.configuration) for job in drawn}
    job = drawn[0]
    ours, before = (one.run(job.id, job.configuration, 0).seed for one in (same, other))
    assert ours != before
    assert same.settings()["search_seed"] == same.search_seed != same.seed
    assert "search_seed" not in other.settings()


def test_what_a_prior_had_otherwise_is_told(later: Study) -> None:
    assert later.unlike_prior == []
    hp = replace(later.base, nes=replace(later.base.nes, centre_agents=9, std_dev=0.5))
    task = replace(later.task, solved_reward=150.0)
    agent = replace(hp.agents[0], test_episodes=7)
    changed = replace(later, base=replace(hp, agents=(agent,)), task=task)
    was = later.base.nes.centre_agents
    # (sigma is searched)
    assert changed.unlike_prior == [
        "task.solved_reward 195.0, not 150.0",
        f"nes.centre_agents {was}, not 9",
        f"ddqn.test_episodes {later.base.agents[0].test_episodes}, not 7",
    ]
    changed.take_over_prior()
    assert changed.unlike_prior == []  # whatever becomes of that one


def test_a_prior_with_the_ranges_of_another_version_is_refused(later: Study) -> None:
    """Its configurations may lie outside of this version's."""
    other = Study.read(later.folder.parent / later.prior)
    other.write_space()
    later.check_prior()
    stored = json.loads((other.folder / SPACE_FILE).read_text())
    (spread,) = (one for one in stored["hyperparameters"] if one["name"] == "nes.std_dev")
    spread["upper"] *= 4
    (other.folder / SPACE_FILE).write_text(json.dumps(stored))
    with pytest.raises(InvalidInput, match="'earlier-one' cannot be the prior: it searched an"):
        later.check_prior()


def test_priors_that_do_not_fit_are_refused(later: Study) -> None:
    unknown = replace(later, prior="unknown")
    with pytest.raises(InvalidInput, match=r"unknown prior 'unknown': .*studies on the same"):
        unknown.check_prior()
    with pytest.raises(InvalidInput, match="'earlier-one' cannot be the prior: it searched an"):
        replace(later, space=Space("full")).check_prior()
    with pytest.raises(InvalidInput, match="prior of the method 'random': only bohb has a"):
        replace(later, method="random").check_prior()
    large = replace(later, schedule=Schedule((10, 30), 1))
    with pytest.raises(InvalidInput, match="it has no results at the budgets 10, 30"):
        large.check_prior()
    for path in Journal(later.folder.parent / later.prior).paths:
        path.unlink()
    with pytest.raises(InvalidInput, match="'earlier-one' cannot be the prior: it has no res"):
        later.check_prior()
    assert not later.folder.exists()
