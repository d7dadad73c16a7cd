"""MLflow view of an NES run; a study's configurations share its parts."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bilevel.hyperparameters import Hyperparameters
from bilevel.nes import NESState
from bilevel.nes.checkpoint import load_state
from bilevel.synthetic_env import load_se, se_bytes
from cluster.nes import pictures
from cluster.nes.run import KIND, STATE_FILE, NESRun, NESSettings, start_of
from cluster.pictures import png
from cluster.storage.run_folder import BEST_FILE, LAST_FILE, Final, Lifetime, RunIdentity, finals
from cluster.tracking import Document, Point, Progress, RegisteredSE, RunView


def edition(states: Sequence[NESState]) -> str | None:
    """Distinguishes runs from their repetition after a damaged checkpoint: the scores are the
    same, the measured times are not. Another run adds to its end."""
    begun = [state.records[0].finished for state in states if state.records]
    return "".join(f"{time!r};" for time in begun) or None


def run_documents(
    states: Sequence[NESState], hp: Hyperparameters, title: str, best: Document
) -> list[Document]:
    """Documents of runs, one after the other: best and last SE, learning curve and
    hyperparameters."""
    records = [record for state in states for record in state.records]
    version = f"generation {len(records)}"

    def curve() -> bytes:
        return png(pictures.learning_curve(records, states[0].task, title))

    current = states[-1].current
    last = Document(LAST_FILE, version, lambda: se_bytes(current))
    return [
        best,
        *([last] if current.se.finite else []),
        Document(CURVE_FILE, version, curve),
        Document.of_text("configuration.json", json.dumps(hp.to_dict(), indent=2)),
    ]


def registered(folder: Path, task_id: str, last: Final) -> RegisteredSE | None:
    """The best SE of a finished run, for the model registry; None while its file is already that of
    another end. Raises InvalidInput if its file cannot be read."""
    content = Document.of_file(folder / BEST_FILE).content()
    info = load_se(folder / BEST_FILE).info  # after the content, which may be replaced between
    if any(info.get(name, value) != value for name, value in last.metrics.items()):
        return None
    tags = {name: f"{value:.6g}" for name, value in last.metrics.items()}
    return RegisteredSE(content, task_id, last.time, tags)


#: File of a run's learning curve, which is also an artifact.
CURVE_FILE = "learning_curve.png"


@dataclass(frozen=True)
class NESViews:
    """The MLflow run of an NES run; `live` while a process works on it."""

    run: NESRun
    identity: RunIdentity
    live: bool

    @classmethod
    def of(cls, folder: Path) -> "NESViews":
        """View of a run that no process works on. Raises InvalidInput if it is damaged."""
        return cls(NESRun.read(folder), RunIdentity.read(folder), False)

    @property
    def task_id(self) -> str:
        """The run's task."""
        return self.run.task.id

    def keys(self) -> list[str]:
        """The run's identity."""
        return [self.identity.uuid]

    def view(self, key: str) -> RunView:
        """The run as it is on disk. Raises InvalidInput."""
        run, ends = self.run, finals(self.run.folder)
        state = run.load_if_sound()
        lifetime = Lifetime.of(run.folder, self.identity.began, self.live)
        points = [] if state is None else [Point.of(record) for record in state.records]
        points += [Point.of_final(end) for end in ends]
        documents: list[Document] = []
        if lifetime.over and state is not None and state.finalists:
            best = (
                Document.of_file(run.folder / BEST_FILE)
                if ends
                else Document(
                    BEST_FILE,
                    f"generation {state.generation}",
                    lambda: se_bytes(run.nes.best(state)),
                )
            )
            documents = run_documents([state], run.hp, f"{self.name} on {run.task.id}", best)
        return RunView(
            key,
            self.name,
            lifetime,
            self._params(),
            {"bilevel.kind": KIND, "bilevel.generations": str(run.hp.nes.generations)},
            tuple(points),
            tuple(documents),
            edition=None if state is None else edition([state]),
            model=registered(run.folder, run.task.id, ends[-1]) if ends else None,
            identity=self.identity,
            description=self._description(),
        )

    @property
    def name(self) -> str:
        """The run's name."""
        return self.run.folder.name

    def _params(self) -> dict[str, Any]:
        """All hyperparameters, but for the number of generations: a run may get more of them, and
        MLflow's parameters stay as they are."""
        params: dict[str, Any] = self.run.hp.to_dict()
        del params["nes"]["generations"]
        return {**params, "seed": self.run.seed, "task": self.run.task.id}

    def _description(self) -> str:
        run, nes = self.run, self.run.hp.nes
        return (
            f"One NES run on **{run.task.id}**, recipe `{run.hp.recipe}`, {start_of(nes)} "
            f"(rule `{nes.update}`, SE structure `{run.hp.se.family}`, population "
            f"{nes.population_size}, step size {nes.step_size:g}, std. dev. {nes.std_dev:g}, "
            f"seed {run.seed}). `real_env_steps` are all steps made on the real task "
            "so far. Per generation: `score_*`, `train_*` and `solved_fraction` are of agents "
            "trained on the unperturbed SE. The run stops early once several generations have "
            "solved the task on average and fresh agents confirm it; `final_*` are of fresh agents "
            "trained on the best SE."
        )


def nes_progress(folder: Path, generations: int) -> Progress:
    """Number of generations, of so many, and the best score of an NES run. Raises InvalidInput.

    The run's agents may be a user's own, which need not be known here.
    """
    path = folder / STATE_FILE
    if not path.exists():
        return Progress(f"0/{generations} generations")
    settings = NESSettings.read(folder)
    state = load_state(path)
    best = f"{state.best_score:.1f}" if state.records else ""
    whole = max(generations, state.generation)  # a later call may ask for fewer
    return Progress(f"{state.generation}/{whole} generations", best)
