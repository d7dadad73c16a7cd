"""MLflow view of an NES run; the configurations of a study share its parts."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bilevel.nes import NESState
from bilevel.nes.checkpoint import load_state
from bilevel.synthetic_env import load_se, se_bytes
from cluster.nes import pictures
from cluster.nes.run import KIND, STATE_FILE, NESRun, start_of
from cluster.pictures import image
from cluster.storage.run_folder import BEST_FILE, LAST_FILE, Final, finals
from cluster.tracking import Document, Point, RegisteredSE, RunView, Views

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
        Document(CURVE_FILE, version, lambda: image(pictures.learning_curve(records, task, title))),
        Document.of("configuration.json", json.dumps(run.hp.to_dict(), indent=2)),
    ]


def registered(folder: Path, task_id: str, last: Final) -> RegisteredSE:
    """The best SE of a finished run for the model registry. Its tags are the scores in its file,
    which may be newer than `last`. Raises InvalidInput if the file cannot be read."""
    file, info = Document.of_file(folder / BEST_FILE), load_se(folder / BEST_FILE).info
    tags = {name: f"{info.get(name, value):.6g}" for name, value in last.metrics.items()}
    return RegisteredSE(file, task_id, last.time, tags)


class NESViews(Views):
    """The MLflow run of an NES run."""

    kind = KIND

    def view(self, key: str) -> RunView:
        """View of the run's current files. Raises InvalidInput."""
        run, ends = NESRun.read(self.folder), finals(self.folder)
        state, ended = run.load_if_sound(), self.lifetime.ended is not None
        params: dict[str, Any] = run.hp.to_dict()
        del params["nes"]["generations"]  # may grow, and MLflow's parameters cannot change
        documents: list[Document] = []
        if ended and state is not None and state.finalists:
            version, best_se = f"generation {state.generation}", run.nes.best(state)
            best = Document(BEST_FILE, version, lambda: se_bytes(best_se))
            if ends:
                best = Document.of_file(run.folder / BEST_FILE)
            documents = run_documents([state], run, f"{run.folder.name} on {run.task.id}", best)
        return self.own_run(
            {**params, "seed": run.seed, "task": run.task.id},
            [] if state is None else [Point.of(record) for record in state.records],
            {"bilevel.generations": str(run.hp.nes.generations)},
            documents=documents,
            model=registered(run.folder, run.task.id, ends[-1]) if ends else None,
            description=(
                f"One NES run on **{run.task.id}**, recipe `{run.hp.recipe}`, "
                f"{start_of(run.hp.nes)}, rule `{run.hp.nes.update}`, seed {run.seed}. `score_*` "
                "describes agents trained on a generation's unperturbed SE, and `final_*` fresh "
                "agents trained on the best SE."
            ),
        )

    def progress(self) -> tuple[str, str]:
        """Number of generations, and the best score."""
        path, target = self.folder / STATE_FILE, self.lifetime.target
        if not path.exists():
            return f"0/{target} generations", ""
        state = load_state(path)
        best = f"{state.best_score:.1f}" if state.records else ""
        total = max(target, state.generation)  # a later call may ask for fewer
        return f"{state.generation}/{total} generations", best
