"""Who began a run, and by which command."""

import shlex
import subprocess
from pathlib import Path

import pytest

import bilevel
from cluster.storage.author import Author


def author(monkeypatch: pytest.MonkeyPatch, *argv: str) -> Author:
    monkeypatch.setattr("sys.argv", list(argv))
    return Author.of_this_process()


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("postgresql://me:secret@host/runs", "postgresql://***@host/runs"),
        ("--tracking-uri=https://me:secret@host:5000", "--tracking-uri=https://***@host:5000"),
        ("postgresql://me:sec/secret@host/runs", "postgresql://***@host/runs"),
        (
            "mysql://host/runs?user=me&password=secret&ssl=1",
            "mysql://host/runs?user=me&password=***&ssl=1",
        ),
        ("mssql://?odbc_connect=DSN%3Dx%3BPWD%3Dsecret", "mssql://?odbc_connect=***"),
        ("sqlite:////home/me@host/runs.db", "sqlite:////home/me@host/runs.db"),
        ("s3://bucket/a@b", "s3://bucket/a@b"),
        ("http://host:5000/#/models/SE@best", "http://host:5000/#/models/SE@best"),
    ],
)
def test_passwords_are_not_kept(given: str, kept: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = author(monkeypatch, "/usr/bin/bilevel", "bohb", "CartPole-v0", given)
    assert shlex.split(found.command) == ["bilevel", "bohb", "CartPole-v0", kept]
    assert "secret" not in str(found)


def test_the_program_is_the_command_without_options(monkeypatch: pytest.MonkeyPatch) -> None:
    found = author(monkeypatch, "/usr/bin/bilevel", "nes", "CartPole-v0", "--home", "/a/b")
    assert found.program == "bilevel nes CartPole-v0"
    assert author(monkeypatch, "bilevel", "sync", "/a/b").program == "bilevel sync"


def test_the_commit_is_that_of_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Path(bilevel.__file__).parents[1]
    if not (source / ".git").exists():
        pytest.skip("the package does not run from a git checkout")
    head = subprocess.check_output(["git", "-C", source, "rev-parse", "HEAD"], text=True)
    assert author(monkeypatch, "bilevel").commit == head.strip()
