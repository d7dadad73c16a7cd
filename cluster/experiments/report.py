"""`bilevel experiment report TASK`: all experiments of a task on one HTML page.

The page embeds its pictures and loads no other file.
"""

import base64
import time
from collections.abc import Iterator
from dataclasses import asdict
from html import escape
from pathlib import Path

import pandas as pd

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput
from cluster.experiments.authors import comparison, titled
from cluster.experiments.command import ExperimentCommand
from cluster.experiments.conditions import title_of
from cluster.experiments.experiment import Experiment
from cluster.experiments.registry import EXPERIMENTS
from cluster.experiments.run import REPORT, REPORT_FILE, StoredFindings
from cluster.experiments.table import Row, table
from cluster.experiments.view import ExperimentViews
from cluster.storage.run_folder import Final, add_final, check_settings

_INTRODUCTION = """
The experiments of Ferreira, Nierhoff and Hutter, Learning Synthetic Environments for Reinforcement
Learning with Evolution Strategies (2021). Authors' rule: NES as in the authors' code. Algorithm 1:
NES with the step divided by n_p sigma, which only the paper's text has; the authors tuned the step
size for the undivided rule, and the recipe compares scores with agents trained on the unperturbed
SE. HP varied and HP fixed: whether NES varied its agents' hyperparameters, otherwise with our
default recipe. Except in the size paper, varied agents are narrowed: a large network is replaced by
a narrow one that learns at the same pace. Values are mean ± standard deviation. The authors'
figures are from the paper, or from constants, plots and curves in its repository,
automl/learning_environments.
"""

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62em; margin: 2em auto; }
h2 { border-top: 1px solid #ccc; padding-top: .8em; } img { width: 26em; margin: 1em; }
table { border-collapse: collapse; font-size: .82em; display: block; overflow-x: auto; }
th, td { padding: .25em .6em; text-align: left; border-bottom: 1px solid #ddd; }
"""


def write_report(command: ExperimentCommand) -> Path:
    """Write the report and log it to MLflow; return its path. Raises InvalidInput before anything
    is written if no experiment has findings."""
    text = report_of(command)
    folder = command.context.home.run_folder(command.task.id, command.name(REPORT))
    path = folder / REPORT_FILE
    with (
        command.context.offline() as driver,
        driver.session(folder, command.task.id, command.settings(REPORT, {})) as session,
    ):
        views = ExperimentViews(folder, session.identity, live=True)
        with session.live(views, 0, "run the same command again"):
            write_aside(path, text.encode())
            add_final(folder, Final(0, time.time(), {"characters": float(len(text))}))
        session.terminal.log(f"report: {path}")
        session.terminal.log(f"MLflow {session.shown_at(session.identity.uuid)}")
    return path


def report_of(command: ExperimentCommand) -> str:
    """Return the page. Raises InvalidInput if no experiment has findings, or if one has other
    values of the task."""
    task, found = command.task, {}
    sections: list[str] = []
    for name, experiment in EXPERIMENTS.items():
        folder = command.context.home.run_folder(task.id, command.name(name))
        findings = StoredFindings.read(folder)
        if findings is not None:
            check_settings(folder, {"task": asdict(task)})
            found[name] = findings
            sections += _section(experiment, findings, folder)
    if not found:
        size = f" --size {command.size.name}" if command.size.quick else ""
        raise InvalidInput(
            f"no experiment on {task.id} has finished yet in "
            f"{str(command.context.home.folder)!r}: start with "
            f"`bilevel experiment all {task.id}{size}`"
        )
    compared = comparison(task.id, {name: one.summary for name, one in found.items()})
    title = f"Synthetic environments for {task.id}"
    missing = ", ".join(name for name in EXPERIMENTS if name not in found) or "none"
    parts = [f"<h1>{escape(title)}</h1>", _paragraph(_INTRODUCTION)]
    parts += [_paragraph(f"Size: {command.size.name}. Missing experiments: {missing}.")]
    if compared:
        parts += ["<h2>The paper's figures and ours</h2>", _html(compared)]
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        + "\n".join([*parts, *sections])
        + "\n</body>\n</html>\n"
    )


def _html(rows: list[Row]) -> str:
    with pd.option_context("display.max_colwidth", None):
        html: str = table(rows).to_html(index=False, border=0)
    return html


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>"


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
