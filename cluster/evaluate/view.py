"""An evaluation of many agents (`bilevel evaluate`) as MLflow shows it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bilevel.errors import InvalidInput
from cluster.storage.run_folder import Begun, Standing, finals, read_settings, stored_task
from cluster.tracking import Document, Point, RunView

#: The kind of run that `settings.json` tells.
KIND = "evaluate"

RESULTS_FILE, REPORT_FILE, PICTURE_FILE = "results.jsonl", "report.json", "violins.png"


@dataclass(frozen=True)
class EvaluationViews:
    """The one run that an evaluation is shown as."""

    folder: Path
    begun: Begun
    live: bool

    @classmethod
    def of(cls, folder: Path) -> "EvaluationViews":
        """Of an evaluation that nobody works on. Raises InvalidInput."""
        settings = read_settings(folder)
        try:
            stored_task(settings["task"])
            types = {"kinds": dict, "sources": dict, "vary": str, "seed": int}
            for name, kind in types.items():
                if not isinstance(settings[name], kind):
                    raise TypeError(f"{name} is {settings[name]!r}")
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidInput(f"{str(folder)!r} holds no evaluation: {error}") from None
        return cls(folder, Begun.read(folder), False)

    @property
    def task_id(self) -> str:
        """The task that the agents are tested on."""
        return str(read_settings(self.folder)["task"]["id"])

    def keys(self) -> list[str]:
        """The evaluation's identity."""
        return [self.begun.identity]

    def view(self, key: str) -> RunView:
        """The run as it is on disk. Raises InvalidInput."""
        settings, ends = read_settings(self.folder), finals(self.folder)
        standing = Standing.load(self.folder) or Standing("KILLED", self.begun.time, 0)
        over = not (self.live and standing.status == "RUNNING")
        kinds: dict[str, Any] = settings["kinds"]
        sources, task = ", ".join(settings["sources"]), settings["task"]["id"]
        note = f"{standing.target} fresh agents of each kind on {sources}, tested on {task}."
        files = [self.folder / name for name in (REPORT_FILE, PICTURE_FILE, RESULTS_FILE)]
        return RunView(
            key,
            self.folder.name,
            standing.ended_as if over else "RUNNING",
            self.begun.time,
            standing.since if over else None,
            {"agents": kinds, "vary": settings["vary"], "seed": settings["seed"], "task": task},
            {"bilevel.kind": KIND, "mlflow.note.content": note},
            tuple(Point.of_final(end) for end in ends),
            tuple(Document.of_file(path) for path in files if over and path.exists()),
        )
