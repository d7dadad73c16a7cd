from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.home import Home, locked_settings
from cluster.progress import duration


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".hidden", "x" * 81, "a\nb", "-x", "a b"])
def test_names_cannot_leave_the_home(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="is not allowed"):
        Home(tmp_path).run_folder("CartPole-v0", name)


def test_task_ids_with_a_namespace_stay_inside(tmp_path: Path) -> None:
    folder = Home(tmp_path).run_folder("ns/../Task-v0", "run")
    assert folder.resolve().is_relative_to(tmp_path)


def test_other_settings_are_refused(tmp_path: Path) -> None:
    with locked_settings(tmp_path / "run", {"seed": 1, "budgets": (1, 3)}) as identity:
        pass
    with locked_settings(tmp_path / "run", {"seed": 1, "budgets": (1, 3)}) as again:
        assert identity == again
    with (
        pytest.raises(InvalidInput, match="'run' was begun with seed = 1, not 2"),
        locked_settings(tmp_path / "run", {"seed": 2, "budgets": (1, 3)}),
    ):
        pass


@pytest.mark.parametrize("content", ["", "[]", "{}", "nonsense"])
def test_damaged_settings_are_told(content: str, tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_text(content)
    with pytest.raises(InvalidInput, match="damaged settings"), locked_settings(tmp_path, {}):
        pass


def test_two_at_once_are_refused(tmp_path: Path) -> None:
    with (
        locked_settings(tmp_path / "run", {}),
        pytest.raises(InvalidInput, match="run by another process"),
        locked_settings(tmp_path / "run", {}),
    ):
        pass


@pytest.mark.parametrize(
    ("seconds", "text"), [(-3, "0s"), (42.4, "42s"), (200, "3m20s"), (7500, "2h05m")]
)
def test_duration(seconds: float, text: str) -> None:
    assert duration(seconds) == text
