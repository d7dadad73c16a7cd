"""`bilevel experiment report TASK`: all experiments of a task on one page."""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from bilevel.durable import write_aside
from bilevel.errors import InvalidInput, first_line
from cluster.experiments.authors import CONDITION, comparison
from cluster.experiments.command import ExperimentCommand
from cluster.experiments.conditions import title_of
from cluster.experiments.page import Picture, Section, page
from cluster.experiments.registry import EXPERIMENTS
from cluster.experiments.run import REPORT, REPORT_FILE, ExperimentSettings, StoredFindings
from cluster.experiments.table import Row
from cluster.experiments.view import ExperimentViews
from cluster.storage.run_folder import SETTINGS_FILE, Final, add_final, check_settings


@dataclass(frozen=True)
class Reported:
    """An experiment that has found something."""

    settings: ExperimentSettings
    findings: StoredFindings
    pictures: tuple[Picture, ...]

    @classmethod
    def read(cls, folder: Path) -> "Reported | None":
        """Read it from its folder; None if nothing has been found yet. Raises InvalidInput."""
        if not (folder / SETTINGS_FILE).exists():
            return None
        settings, findings = ExperimentSettings.read(folder), StoredFindings.read(folder)
        if findings is None:
            return None
        title = EXPERIMENTS[settings.experiment].title
        pictures = tuple(_picture(folder, name, title) for name in findings.pictures)
        return cls(settings, findings, pictures)

    @property
    def planned(self) -> dict[str, int]:
        """NES runs that it needs, by condition."""
        return EXPERIMENTS[self.settings.experiment].runs(self.findings.size)

    def ended(self, condition: str) -> int:
        """NES runs of a condition that its findings rest on."""
        return self.findings.runs.get(condition, 0)

    @property
    def under_way(self) -> str | None:
        """How far it has come, in words; None at its end."""
        ended, planned = sum(map(self.ended, self.planned)), sum(self.planned.values())
        if ended == planned:
            return None
        return f"{self.settings.experiment} ({ended} of {planned} NES runs have ended)"

    @property
    def section(self) -> Section:
        """The experiment on the page."""
        experiment, findings = EXPERIMENTS[self.settings.experiment], self.findings
        runs = "; ".join(
            f"{title_of(name)}: {self.ended(name)} of {n}" for name, n in self.planned.items()
        )
        size = ", ".join(f"{name} {value}" for name, value in asdict(findings.size).items())
        agents = "; ".join(
            f"{agent}: " + ", ".join(f"{name} {value}" for name, value in hp.items())
            for agent, hp in self.settings.kinds.items()
        )
        versions = ", ".join(f"{name} {number}" for name, number in findings.versions.items())
        return Section(
            experiment.title,
            experiment.explanation,
            self.pictures,
            [_titled(row) for row in findings.summary],
            findings.notes,
            (
                ("command", findings.command),
                ("commit", findings.commit or "-"),
                ("seed", str(self.settings.seed)),
                ("size", size),
                ("NES runs", runs),
                ("agents before their hyperparameters are drawn", agents),
                ("versions", versions),
            ),
        )


def _titled(row: Row) -> Row:
    """The row with the titles of conditions, as pictures have them."""
    return {
        name: title_of(value) if name in CONDITION and isinstance(value, str) else value
        for name, value in row.items()
    }


def _picture(folder: Path, name: str, title: str) -> Picture:
    path = folder / name
    if path.parent != folder or path.suffix != ".svg":
        raise InvalidInput(f"picture {name!r} of {str(folder)!r} is not allowed")
    try:
        svg = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"cannot read {str(path)!r}: {first_line(error)}") from None
    if "<svg" not in svg:
        raise InvalidInput(f"damaged picture {str(path)!r}: run its experiment again")
    caption = f"{title}: {path.stem} ({folder.name}/{name})"
    return Picture(f"{folder.name}/{name}", caption, svg)


def report_of(command: ExperimentCommand) -> str:
    """The page, from the folders alone. Raises InvalidInput if no experiment has been run, or one
    with other values of the task."""
    found: dict[str, Reported] = {}
    for name in EXPERIMENTS:
        folder = command.context.home.run_folder(command.task.id, command.name(name))
        reported = Reported.read(folder)
        if reported is not None:
            check_settings(folder, {"task": asdict(command.task)})
            found[name] = reported
    task = command.task
    if not found:
        size = f" --size {command.size.name}" if command.size.quick else ""
        raise InvalidInput(
            f"no experiment on {task.id} has ended yet in {str(command.context.home.folder)!r}: "
            f"begin with `bilevel experiment all {task.id}{size}`"
        )
    summaries = {name: one.findings.summary for name, one in found.items()}
    compared = comparison(task.id, summaries)
    return page(
        f"Synthetic environments for {task.id}",
        _introduction(command, found, bool(compared)),
        compared,
        [one.section for one in found.values()],
    )


def _introduction(
    command: ExperimentCommand, found: Mapping[str, Reported], compared: bool
) -> list[str]:
    task, missing = command.task, [name for name in EXPERIMENTS if name not in found]
    texts = [
        f"The experiments of Ferreira, Nierhoff and Hutter, Learning Synthetic Environments for "
        f"Reinforcement Learning with Evolution Strategies (2021), on {task.id} (episodes of at "
        f"most {task.step_limit} steps, solved at a mean return of {task.solved_reward:g}). All "
        "SEs are learned by NES from random ones, unless they are called distilled.",
        "Algorithm 1 and the authors' rule: NES as the paper prints it, and as its authors' code "
        "has it, which does not divide the step by n_p sigma; both with the paper's population "
        "and agent. HP varied and HP fixed: whether NES varied its agents' hyperparameters, with "
        "our default recipe in all else. In sizes other than paper, varied agents are narrowed: a "
        "large network is replaced by a narrow one that learns at the same pace. Values are mean ± "
        "standard deviation.",
    ]
    if compared:
        texts.append(
            "The authors' figures in the same condition are of their own code and their own NES; "
            "they are from the paper, or from constants, plots and curves in its repository, "
            "automl/learning_environments. The table tells the evaluations behind each figure."
        )
    if command.size.quick:
        texts.append("Size smoke: this page shows that all works; its numbers mean nothing.")
    if under_way := [text for one in found.values() if (text := one.under_way) is not None]:
        texts.append(f"Under way: {', '.join(under_way)}.")
    if missing:
        texts.append(f"Not run yet: {', '.join(missing)}.")
    return texts


def write_report(command: ExperimentCommand) -> Path:
    """Write the report and log it to MLflow; return its path. Raises InvalidInput before anything
    is written if no experiment has been run."""
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
