from pathlib import Path

import pytest

from bilevel import InvalidInput
from cluster.storage.home import DEFAULT_HOME, Home, require_writable


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
    with pytest.raises(InvalidInput, match=r"several runs are called 'two'.*A-v0/two, B-v0/two"):
        home.find("two")
    with pytest.raises(InvalidInput, match=r"no run is called '\.\./x'.*there are A-v0/one"):
        home.find("../x")


def test_hints_name_the_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert Home(tmp_path / "a b").hint("ui") == f"`bilevel ui --home '{tmp_path}/a b'`"
    monkeypatch.chdir(tmp_path)
    assert Home(DEFAULT_HOME).hint("ui") == "`bilevel ui`"


@pytest.mark.parametrize("name", ["a?b", "a%20b"])
def test_a_path_that_a_database_uri_cannot_contain_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="its path must not contain"):
        Home(tmp_path / name)


def test_a_home_is_created_only_if_it_can_be_written(tmp_path: Path) -> None:
    home = Home(tmp_path / "new" / "home")
    require_writable(home.folder)
    assert list(tmp_path.iterdir()) == []
    home.prepare()
    assert list(home.folder.iterdir()) == []
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file" / "home", Path("/proc/none")):
        with pytest.raises(InvalidInput, match=f"cannot write to '{folder}'"):
            Home(folder).prepare()
