"""MLflow view of an NES run; the configurations of a study share its parts."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bilevel.nes import NESState
from bilevel.nes.checkpoint import load_state
from bilevel.synthetic_env import load_se, se_bytes
from cluster.nes import pictures
from cluster.nes.run import KIND, STATE_FILE, NESRun, start_of
from cluster.pictures import png
from cluster.storage.run_folder import BEST_FILE, LAST_FILE, Final, Lifetime, RunIdentity, finals
from cluster.tracking import Document, Point, Progress, RegisteredSE, RunView

#: File of a run's learning curve, which is also an artifact.
CURVE_FILE = "learning_curve.png"


def run_documents(
    states: Sequence[NESState], run: NESRun, title: str, best: Document
) -> list[Document]:
    """Return the best and last SE, learning curve and hyperparameters of consecutive runs with the
    task and hyperparameters of `run`."""
    records = [record for state in states for record in state.records]
    version = f"generation {len(records)}"
    task, current = run.task, run.nes.current(states[-1])
    last = Document(LAST_FILE, version, lambda: se_bytes(current))
    return [
        best,
        *([last] if current.se.finite else []),
        Document(CURVE_FILE, version, lambda: png(pictures.learning_curve(records, task, title))),
        Document.of_text("configuration.json", json.dumps(run.hp.to_dict(), indent=2)),
    ]


def registered(folder: Path, task_id: str, last: Final) -> RegisteredSE:
    """The best SE of a finished run for the model registry. Its tags are the scores in its file,
    which may be newer than `last`. Raises InvalidInput if the file cannot be read."""
    file, info = Document.of_file(folder / BEST_FILE), load_se(folder / BEST_FILE).info
    tags = {name: f"{info.get(name, value):.6g}" for name, value in last.metrics.items()}
    return RegisteredSE(file, task_id, last.time, tags)


@dataclass(frozen=True)
class NESViews:
    """The MLflow run of an NES run; `live` while this process works on it."""

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
        """The run's UUID."""
        return [self.identity.uuid]

    def view(self, key: str) -> RunView:
        """View of the run's current files. Raises InvalidInput."""
        run, ends = self.run, finals(self.run.folder)
        state = run.load_if_sound()
        lifetime = Lifetime.of(run.folder, self.identity.began, self.live)
        points = [] if state is None else [Point.of(record) for record in state.records]
        points += [Point.of_final(end) for end in ends]
        params: dict[str, Any] = run.hp.to_dict()
        del params["nes"]["generations"]  # may grow, and MLflow's parameters cannot change
        documents: list[Document] = []
        if lifetime.over and state is not None and state.finalists:
            version, best_se = f"generation {state.generation}", run.nes.best(state)
            best = Document(BEST_FILE, version, lambda: se_bytes(best_se))
            if ends:
                best = Document.of_file(run.folder / BEST_FILE)
            title = f"{run.folder.name} on {run.task.id}"
            documents = run_documents([state], run, title, best)
        return RunView(
            key,
            run.folder.name,
            lifetime,
            {**params, "seed": run.seed, "task": run.task.id},
            {"bilevel.kind": KIND, "bilevel.generations": str(run.hp.nes.generations)},
            tuple(points),
            tuple(documents),
            model=registered(run.folder, run.task.id, ends[-1]) if ends else None,
            identity=self.identity,
            description=(
                f"One NES run on **{run.task.id}**, recipe `{run.hp.recipe}`, "
                f"{start_of(run.hp.nes)}, rule `{run.hp.nes.update}`, seed {run.seed}. `score_*` "
                "describes agents trained on a generation's unperturbed SE, and `final_*` fresh "
                "agents trained on the best SE."
            ),
        )


def nes_progress(folder: Path, generations: int) -> Progress:
    """Number of generations, out of `generations`, and the best score. Raises InvalidInput.

    Custom agents of the run need not be installed.
    """
    path = folder / STATE_FILE
    if not path.exists():
        return Progress(f"0/{generations} generations")
    state = load_state(path)
    best = f"{state.best_score:.1f}" if state.records else ""
    total = max(generations, state.generation)  # a later call may ask for fewer
    return Progress(f"{state.generation}/{total} generations", best)
