import shlex

import pytest

from cluster.storage.author import Author, commit


def author(monkeypatch: pytest.MonkeyPatch, *argv: str) -> Author:
    monkeypatch.setattr("sys.argv", list(argv))
    return Author.of_this_process()


@pytest.mark.parametrize(
    ("argument", "stored"),
    [
        ("postgresql://me:secret@host/runs", "postgresql://***@host/runs"),
        ("--tracking-uri=https://me:secret@host:5000", "--tracking-uri=https://***@host:5000"),
        ("mysql://host/runs?password=a&ssl=1", "mysql://host/runs?password=***&ssl=1"),
        ("sqlite:////home/me@host/runs.db", "sqlite:////home/me@host/runs.db"),
        ("http://host:5000/#/models/SE@best", "http://host:5000/#/models/SE@best"),
    ],
)
def test_passwords_are_masked(argument: str, stored: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = author(monkeypatch, "/usr/bin/bilevel", "bohb", "CartPole-v0", argument)
    assert shlex.split(found.command) == ["bilevel", "bohb", "CartPole-v0", stored]
    assert found.commit == commit()
