from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.session.terminal import duration
from cluster.storage.home import Home


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".hidden", "x" * 81, "a\nb", "-x", "a b"])
def test_names_cannot_leave_the_home(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="is not allowed"):
        Home(tmp_path).run_folder("CartPole-v0", name)


def test_task_ids_with_a_namespace_stay_inside(tmp_path: Path) -> None:
    folder = Home(tmp_path).run_folder("ns/../Task-v0", "run")
    assert folder.resolve().is_relative_to(tmp_path)


def test_a_run_is_found_by_its_name(tmp_path: Path) -> None:
    home = Home(tmp_path)
    for task, name in (("A-v0", "one"), ("A-v0", "two"), ("B-v0", "two")):
        folder = home.run_folder(task, name)
        folder.mkdir(parents=True)
        (folder / "settings.json").touch()
    assert home.find("one") == tmp_path / "A-v0" / "one"
    assert home.find("B-v0/two") == tmp_path / "B-v0" / "two"
    with pytest.raises(InvalidInput, match=r"several studies are called 'two'.*A-v0/two, B-v0/two"):
        home.find("two")
    with pytest.raises(InvalidInput, match=r"no study is called '\.\./x'.*there are A-v0/one"):
        home.find("../x")


@pytest.mark.parametrize(
    ("seconds", "text"), [(-3, "0s"), (42.4, "42s"), (200, "3m20s"), (7500, "2h05m")]
)
def test_duration(seconds: float, text: str) -> None:
    assert duration(seconds) == text
