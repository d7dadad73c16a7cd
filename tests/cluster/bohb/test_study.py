"""What a study hands over."""

from dataclasses import replace
from pathlib import Path

from bilevel.hyperparameters import load_recipe
from cluster.bohb.journal import Journal
from tests.commands import run_bilevel
from tests.studies import make_study, new_study


def test_a_configuration_is_handed_over_as_the_recipe_that_its_runs_had(tmp_path: Path) -> None:
    make_study(tmp_path / "study")
    study, line = new_study(tmp_path / "study"), Journal(tmp_path / "study").configs[0]
    path = tmp_path / "found.toml"
    path.write_text(study.recipe_text(line.id, line.configuration))
    found = load_recipe(str(path), study.task)
    assert replace(found, recipe="default") == study.run(line.id, line.configuration, 0).hp
    assert found.nes.solved_for > 0


def test_a_study_without_an_incumbent_has_no_recipe(tmp_path: Path) -> None:
    make_study(tmp_path / "CartPole-v0" / "mine")
    arguments = ("nes", "CartPole-v0", "--recipe", "mine", "--home", str(tmp_path))
    result = run_bilevel(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert (
        "'mine' on CartPole-v0 has found no recipe: give a study that has run to its end"
        in result.stderr
    )
