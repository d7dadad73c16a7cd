"""Setting of the faults: a Ray cluster of several nodes, and small studies."""

import os
import random
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import psutil
from ray.cluster_utils import Cluster

from cluster.storage.home import Home
from tests.commands import start_bilevel
from tests.faults.outcome import Outcome
from tests.mlflow_shown import disagreements

TASK = "CartPole-v0"
STUDY = "study"

#: Brackets of a study: one has four results, two have six, and last twice as long.
BRACKETS = 2

#: A trial, which has an actor, takes five core seconds to start: one, where their number does not
#: matter.
ONE_BY_ONE = ("--concurrent-trials", "1")

#: Arguments of a head node without the services that only show what happens.
WITHOUT_VIEWS = {"include_dashboard": False, "include_log_monitor": False}

#: Titles of the processes of actors and trials, when they work and when they wait.
ACTOR, TRIAL = ("ray::_Worker",), ("ray::ResourceTrainable", "ray::NESTrial")

_LONGEST = 480.0  # seconds that any study may take


def smoke(brackets: int = BRACKETS) -> tuple[str, ...]:
    """Options of a study that is small enough to run repeatedly."""
    size = ("--profile", "smoke", "--brackets", str(brackets), "--study", STUDY)
    small = ("--set", "ddqn.hidden_size=16", "--set", "ddqn.batch_size=16", "--vary-hp", "no")
    return (*size, *small, "--set", "nes.centre_agents=2", "--set", "nes.patient_episodes=0")


class Stage:
    """A Ray cluster on this machine; a context manager that ends it.

    `folder` holds homes and logs. Each node is a raylet with one core. Studies have so many
    brackets.
    """

    def __init__(
        self, folder: Path, cores: int = 1, seed: int = 0, brackets: int = BRACKETS
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.brackets = brackets
        self.chance = random.Random(seed)
        self.cluster = Cluster(
            initialize_head=True, head_node_args={"num_cpus": cores, **WITHOUT_VIEWS}
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.cluster.shutdown()

    def study(self, name: str, *options: str, tracking_uri: str | None = None) -> "StudyOnStage":
        """A new study in its own home `name`, not started yet."""
        home = Home(self.folder / name)
        uri = tracking_uri or home.database_uri
        arguments = ["bohb", TASK, *smoke(self.brackets), *options, "--home", str(home.folder)]
        arguments += ["--address", self.cluster.address, "--tracking-uri", uri]
        return StudyOnStage(home, uri, arguments, self.folder / f"{name}.log")

    def processes(self, *titles: str) -> list[psutil.Process]:
        """Processes of this cluster's nodes whose title, set by Ray, begins with the given text."""
        found = []
        for node in self.cluster.list_all_nodes():
            try:
                raylet = psutil.Process(node.all_processes["raylet"][0].process.pid)
                found += [
                    child
                    for child in raylet.children(recursive=True)
                    if " ".join(child.cmdline()).startswith(titles)
                ]
            except (psutil.Error, KeyError, IndexError):
                continue
        return found


class StudyOnStage:
    """A study that is run in processes which may be killed."""

    def __init__(self, home: Home, tracking_uri: str, arguments: list[str], log: Path) -> None:
        self.home = home
        self.tracking_uri = tracking_uri
        self.arguments = arguments
        self.log = log

    @property
    def folder(self) -> Path:
        """The study's folder."""
        return self.home.run_folder(TASK, STUDY)

    def live(self, seconds: float, *numbers: int) -> int:
        """Run until `seconds` have passed, then send the signals, half a second apart; the
        exit code."""
        process = start_bilevel(self.arguments, self.log)
        process.join(seconds)
        for number in numbers:
            if process.is_alive() and process.pid is not None:
                os.kill(process.pid, number)
                process.join(0.5)
        process.join(60)
        if process.is_alive():
            raise TimeoutError(f"the study does not stop: see {self.log}")
        return process.exitcode or 0

    def run(self, meanwhile: Callable[[], None] | None = None) -> int:
        """Run to the end; return the exit code. `meanwhile` is called repeatedly."""
        process = start_bilevel(self.arguments, self.log)
        deadline = time.monotonic() + _LONGEST
        while process.is_alive():
            if meanwhile is not None:
                meanwhile()
            process.join(0.1)
            if time.monotonic() > deadline:
                process.kill()
                raise TimeoutError(f"the study does not end: see {self.log}")
        return process.exitcode or 0

    def outcome(self) -> Outcome:
        """The study's outcome."""
        return Outcome.of(self.folder)

    def disagreements(self) -> list[str]:
        """Differences between MLflow and the disk."""
        return disagreements(self.folder, self.tracking_uri)
