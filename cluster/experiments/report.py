"""`bilevel experiment report TASK`: all experiments of a task on one HTML page.

The page embeds its pictures and loads no other file.
"""

import base64
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path

import pandas as pd

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput
from cluster.evaluate.report import Row, table
from cluster.experiments.authors import comparison, titled
from cluster.experiments.command import ExperimentCommand
from cluster.experiments.conditions import title_of
from cluster.experiments.experiment import Experiment
from cluster.experiments.figures import EXPERIMENTS
from cluster.experiments.run import REPORT, REPORT_FILE, ExperimentViews, StoredFindings
from cluster.storage.run_folder import check_settings

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 62em; margin: 2em auto; }}
img {{ width: 26em; margin: 1em; }}
th, td {{ padding: .25em .6em; text-align: left; }}
</style>
</head>
<body>
<h1>{title}</h1>
<p>The experiments of Ferreira, Nierhoff and Hutter, Learning Synthetic Environments for
Reinforcement Learning with Evolution Strategies (2021). Values are mean ± standard deviation.</p>
{body}
</body>
</html>
"""


def write_report(command: ExperimentCommand) -> None:
    """Write the report and log it to MLflow. Raises InvalidInput before anything is written if no
    experiment has findings, or if one has other values of the task."""
    task, home = command.task, command.context.home
    found: dict[str, Sequence[Row]] = {}
    sections: list[str] = []
    for name, experiment in EXPERIMENTS.items():
        folder = home.run_folder(task.id, command.name(name))
        findings = StoredFindings.read(folder)
        if findings is not None:
            check_settings(folder, {"task": asdict(task)})
            found[name] = findings.summary
            sections += _section(experiment, findings, folder)
    if not found:
        raise InvalidInput(
            f"no experiment on {task.id} has finished yet in {str(home.folder)!r}: start with "
            f"`bilevel experiment all {task.id} --size {command.size.name}`"
        )
    if compared := comparison(task.id, found):
        sections = ["<h2>The paper's figures and ours</h2>", _html(compared), *sections]
    title = escape(f"Synthetic environments for {task.id}")
    page = _PAGE.format(title=title, body="\n".join(sections))
    folder = home.run_folder(task.id, command.name(REPORT))
    with (
        command.context.offline() as driver,
        driver.session(folder, task.id, command.settings(REPORT, {})) as session,
    ):
        with session.live(ExperimentViews(folder, live=True), 0, "run the same command again"):
            write_aside(folder / REPORT_FILE, page.encode())
        session.terminal.log(f"report: {folder / REPORT_FILE}")
        session.terminal.log(f"MLflow {session.address}")


def _section(experiment: Experiment, findings: StoredFindings, folder: Path) -> Iterator[str]:
    yield f"<h2>{escape(experiment.title)}</h2>"
    yield _paragraph(experiment.explanation)
    for name in findings.pictures:
        data = base64.b64encode((folder / Path(name).name).read_bytes()).decode()
        yield f'<img alt="{escape(name)}" src="data:image/svg+xml;base64,{data}">'
    yield _html([titled(row) for row in findings.summary])
    versions = ", ".join(f"{name} {number}" for name, number in findings.versions.items())
    runs = ", ".join(f"{title_of(name)} {number}" for name, number in findings.runs.items())
    for text in (
        *findings.notes,
        f"Size {findings.size.name}; NES runs: {runs}.",
        f"Command: {findings.command} (commit {findings.commit}; {versions}).",
    ):
        yield _paragraph(text)


def _html(rows: list[Row]) -> str:
    with pd.option_context("display.max_colwidth", None):
        return str(table(rows).to_html(index=False, border=0))


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"
