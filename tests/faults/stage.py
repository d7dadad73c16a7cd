"""A Ray cluster of several nodes, and small studies that run on it."""

import os
import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

import psutil
from ray.cluster_utils import Cluster

from cluster.storage.home import Home
from tests.commands import start_bilevel
from tests.faults.outcome import Outcome, Row
from tests.mlflow_shown import disagreements

TASK = "CartPole-v0"
STUDY = "study"

#: Brackets of a study: one bracket has four results; two have six and take twice as long.
BRACKETS = 2

#: One trial at a time, where the number does not matter: a trial takes 5 core seconds to start.
ONE_BY_ONE = ("--concurrent-trials", "1")

#: Arguments of a head node without dashboard and log monitor.
WITHOUT_VIEWS = {"include_dashboard": False, "include_log_monitor": False}

#: Titles of the processes of actors and trials.
ACTOR, TRIAL = ("ray::_Worker",), ("ray::ResourceTrainable", "ray::NESTrial")

#: Options of a study that is small enough to run repeatedly.
_SMALL = (
    *("--profile", "smoke", "--study", STUDY, "--vary-hp", "no"),
    *("--set", "ddqn.hidden_size=16", "--set", "ddqn.batch_size=16"),
    *("--set", "nes.centre_agents=2", "--set", "nes.patient_episodes=0"),
)

_TIMEOUT = 480.0  # seconds per study


class Stage:
    """A Ray cluster on this machine, whose nodes have one core each; a context manager.

    `folder` contains homes and logs.
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

    def __exit__(self, *exc: object) -> None:
        self.cluster.shutdown()

    @cached_property
    def reference(self) -> Outcome:
        """Outcome of an undisturbed study."""
        study = self.study("undisturbed")
        if study.run() != 0 or study.disagreements():
            raise RuntimeError(f"the undisturbed study failed: see {study.log}")
        return study.outcome()

    def study(
        self,
        name: str,
        *options: str,
        tracking_uri: str | None = None,
        own_cluster: bool = False,
    ) -> "StageStudy":
        """Return a new study in its own home `name`; `own_cluster` makes it start Ray itself."""
        home = Home(self.folder / name)
        uri = tracking_uri or home.database_uri
        arguments = ["bohb", TASK, *_SMALL, "--brackets", str(self.brackets)]
        arguments += [*(options or ONE_BY_ONE), "--home", str(home.folder), "--tracking-uri", uri]
        if not own_cluster:
            arguments += ["--address", self.cluster.address]
        return StageStudy(home, uri, arguments, self.folder / f"{name}.log")

    def processes(self, titles: tuple[str, ...]) -> list[psutil.Process]:
        """Return the processes on this cluster whose title starts with one of the given ones."""
        found = []
        for node in self.cluster.list_all_nodes():
            try:
                raylet = psutil.Process(node.all_processes["raylet"][0].process.pid)
                for child in raylet.children(recursive=True):
                    if " ".join(child.cmdline()).startswith(titles):
                        found.append(child)
            except (psutil.Error, KeyError, IndexError):
                continue
        return found

    def row(
        self, fault: str, injected: int, exit_code: int, study: "StageStudy", ordered: bool = True
    ) -> Row:
        """Compare a finished study with the reference, optionally ignoring the results' order."""
        outcomes = [self.reference, study.outcome()]
        reference, outcome = outcomes if ordered else [outcome.sorted() for outcome in outcomes]
        return Row.compare(fault, injected, exit_code, reference, outcome, study.disagreements())


@dataclass(frozen=True)
class StageStudy:
    """A study whose processes may be killed."""

    home: Home
    tracking_uri: str
    arguments: list[str]
    log: Path

    @property
    def folder(self) -> Path:
        """The study's folder."""
        return self.home.run_folder(TASK, STUDY)

    def run(self, meanwhile: Callable[[], None] = lambda: None) -> int:
        """Run to the end, calling `meanwhile` repeatedly; return the exit code."""
        process = start_bilevel(self.arguments, self.log)
        deadline = time.monotonic() + _TIMEOUT
        while process.is_alive():
            meanwhile()
            process.join(0.1)
            if time.monotonic() > deadline:
                process.kill()
                raise TimeoutError(f"the study does not end: see {self.log}")
        return process.exitcode or 0

    def run_for(self, seconds: float, *signals: int) -> int:
        """Run for some seconds, then send the signals, 0.5 s apart; return the exit code."""
        process = start_bilevel(self.arguments, self.log)
        process.join(seconds)
        for number in signals:
            if process.is_alive() and process.pid is not None:
                os.kill(process.pid, number)
                process.join(0.5)
        process.join(60)
        if process.is_alive():
            raise TimeoutError(f"the study does not stop: see {self.log}")
        return process.exitcode or 0

    def outcome(self) -> Outcome:
        """Read the study's outcome."""
        return Outcome.of(self.folder)

    def disagreements(self) -> list[str]:
        """Return differences between MLflow and the disk."""
        return disagreements(self.folder, self.tracking_uri)


class Injector:
    """Inject a fault up to `times` times while a study runs, after random pauses in seconds.

    `fault` returns whether it could be injected; otherwise it is called again soon.
    """

    def __init__(
        self,
        stage: Stage,
        fault: Callable[[], bool],
        times: int,
        delay: float = 0.0,
        pause: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.injected = 0
        self._stage, self._fault, self._times, self._pause = stage, fault, times, pause
        self._next = time.monotonic() + delay

    def __call__(self) -> None:
        if self.injected < self._times and time.monotonic() >= self._next and self._fault():
            self.injected += 1
            self._next = time.monotonic() + self._stage.chance.uniform(*self._pause)
