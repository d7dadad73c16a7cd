"""The authors' figures, tables, and the report's page."""

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from bilevel.errors import InvalidInput
from bilevel.tasks import BUILT_IN_TASKS
from cluster.experiments.authors import authors_figures, comparison
from cluster.experiments.page import Picture, Section, inlined, page
from cluster.experiments.registry import EXPERIMENTS
from cluster.experiments.report import _picture, _titled
from cluster.experiments.style import column, styled, svg
from cluster.experiments.table import Row, cells, csv_bytes, shown, standard_error, text_lines
from tests.cluster.experiments.made_up import findings_of


def test_each_figure_of_the_authors_names_its_source() -> None:
    for figure in authors_figures():
        assert figure.source in ("paper", "repository", "curves in the repository")
        assert figure.task in BUILT_IN_TASKS
        assert figure.experiment in EXPERIMENTS
        assert figure.behind


def test_each_figure_of_the_authors_has_one_of_ours(tmp_path: Path) -> None:
    """Its row and column are found in what our experiments find."""
    summaries = {
        name: findings_of(EXPERIMENTS[name], tmp_path).summary
        for name in ("success", "transfer", "behaviour")
    }
    rows = comparison("CartPole-v0", summaries)
    assert len(rows) == sum(f.task == "CartPole-v0" for f in authors_figures())
    for row in rows:
        # Of five SEs at least, and of runs that have solved the task.
        if row["figure"] not in ("five best SEs", "median first solved"):
            assert (row["evaluations (ours)"], row["evaluations (default)"]) != ("-", "-")
    by_name = {(row["condition"], row["figure"]): row for row in rows}
    steps = by_name["td3; SE, HP varied", "train steps"]
    assert steps["authors"] == "5832 ± 1577"
    assert steps["evaluations (authors)"] == "400 agents"
    assert steps["evaluations (ours)"] == "2 agents"
    assert by_name["td3; SE, HP varied", "train episodes std"]["evaluations (ours)"] == "2 agents"
    returns = by_name["ddqn; real task", "test return"]
    assert returns["evaluations (ours)"] == "2 test episodes"
    assert returns["ours, default recipe"] == "-"  # the real task has no recipe


def test_evaluations_behind_a_part_of_a_row() -> None:
    transfer: Row = {
        "agent": "td3",
        "source": "varied",
        "ses": 10,
        "agents": 100,
        "evaluations": 1000,
        "five_best_ses": 180.0,
    }
    success: Row = {
        "condition": "authors",
        "runs": 8,
        "ever_solved": 0.25,
        "median_first_solved": 40.0,
    }
    rows = comparison("CartPole-v0", {"transfer": [transfer], "success": [success]})
    behind = {(row["condition"], row["figure"]): row["evaluations (ours)"] for row in rows}
    assert behind["td3; SE, HP varied", "five best SEs"] == "500 test episodes"
    assert behind["authors' rule", "median first solved"] == "2 runs"
    assert behind["authors' rule", "ever solved"] == "8 runs"


def test_figures_without_experiments_of_ours() -> None:
    rows = comparison("Acrobot-v1", {})
    assert rows
    assert all(row["ours, same condition"] == row["ours, default recipe"] == "-" for row in rows)
    assert comparison("MountainCar-v0", {}) == []


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "-"),
        ("ddqn", "ddqn"),
        (7, "7"),
        (4000, "4000"),
        (16888.4, "16\u202f888"),
        (190.666, "190.7"),
        (1234.5, "1234"),
        (0.35, "0.35"),
        (0.0, "0.00"),
        (0.00034, "0.00034"),
        (-90.24, "-90.2"),
    ],
)
def test_digits(value: str | float | int | None, text: str) -> None:
    assert shown(value) == text


def test_the_standard_error_of_independent_samples() -> None:
    samples = np.array([[1.0, 10.0], [3.0, 10.0], [5.0, 10.0]])
    np.testing.assert_allclose(standard_error(samples), [2 / np.sqrt(3), 0])


def test_rows_of_the_page_have_the_titles_of_conditions() -> None:
    assert _titled({"source": "varied", "agent": "td3", "ses": 3}) == {
        "source": "SE, HP varied",
        "agent": "td3",
        "ses": 3,
    }


def test_tables() -> None:
    rows: list[Row] = [{"agent": "ddqn", "x": 20.0, "x_std": 1.5}, {"agent": "td3", "x": None}]
    assert cells(rows) == (["agent", "x"], [["ddqn", "20.0 ± 1.50"], ["td3", "-"]])
    assert text_lines(rows) == ["agent  x", "ddqn   20.0 ± 1.50", "td3    -"]
    assert csv_bytes(rows) == b"agent,x,x_std\nddqn,20.0,1.5\ntd3,,\n"


class _Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids += [value or "" for name, value in attrs if name == "id"]
        self.loaded += [value or "" for name, value in attrs if name.endswith(("src", "href"))]
        if tag not in ("meta",):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def picture(name: str) -> Picture:
    with styled():
        figure = column(1.5)
        axes = figure.subplots()
        axes.bar([1, 2], [3, 4], hatch="//")
        axes.plot([1, 2], [3, 4], marker="o")
        axes.set_xlabel(name)
    return Picture(name, f"Figure {name}", svg(figure).decode())


def test_the_page_is_one_file_that_says_what_it_is_given() -> None:
    section = Section(
        "Cost & benefit",
        "What <it> is.",
        [picture("a/one.svg"), picture("b/one.svg")],
        [{"x": "<script>"}],
        ["A note."],
        [("seed", "0")],
    )
    text = page("SEs", ["Begin."], [{"figure": "steps", "authors": "1 ± 2"}], [section])
    read = _Page(text)
    assert read.open == []  # each tag is closed
    assert len(set(read.ids)) == len(read.ids)  # also those of two pictures
    assert read.loaded
    assert all(target.startswith("#") for target in read.loaded)  # nothing is fetched
    assert "Cost &amp; benefit" in text
    assert "<script>" not in text
    assert text.count("<svg") == 2
    assert "<figcaption>Figure a/one.svg</figcaption>" in text


def test_pictures_keep_their_own_references() -> None:
    text = inlined(picture("a/one.svg"))
    assert text.startswith("<svg")
    ids = set(re.findall(r'\bid="([^"]+)"', text))
    used = {*re.findall(r"url\(#([^)]+)\)", text), *re.findall(r'href="#([^"]+)"', text)}
    assert used
    assert used <= ids


@pytest.mark.parametrize("content", [b"", b"a text", b"\xff\xfe"])
def test_a_damaged_picture_is_told(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "one.svg").write_bytes(content)
    with pytest.raises(InvalidInput, match=r"(damaged picture|cannot read) '.*one.svg'"):
        _picture(tmp_path, "one.svg", "Success")
