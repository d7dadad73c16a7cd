from benchmarks.readme import README, TABLES, filled


def test_readme_shows_the_committed_results() -> None:
    text = README.read_text()
    for name in TABLES:
        assert f"<!-- {name} -->" in text
    assert filled(text) == text, "run `python -m benchmarks.readme`"
