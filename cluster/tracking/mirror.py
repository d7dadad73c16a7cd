"""Keeps MLflow up to date with the disk, in its own thread.

The disk is the truth and MLflow a view of it. A running study only marks changed runs; if MLflow is
unreachable, the marks wait while the study continues.
"""

import threading
import time
from collections.abc import Callable, Iterable

from bilevel.errors import first_line
from cluster.storage.author import without_password
from cluster.tracking.tracker import Tracker
from cluster.tracking.view import DocumentFailed, RunView

#: First and longest delay in seconds before MLflow is tried again; the delay doubles each time.
_FIRST_RETRY, _LAST_RETRY = 1.0, 30.0

#: Seconds that the end of a run waits for MLflow to catch up: if it answers, and if not.
_PATIENCE, _PATIENCE_AWAY = 120.0, 10.0


class Mirror:
    """Writes the runs whose keys are marked to MLflow.

    `view_of` builds a key's view from disk, in the mirror's thread. `log` gets a line when MLflow
    becomes unreachable or reachable again. A run that MLflow does not take while it takes others
    is left out, with a line, until it is marked again.
    """

    def __init__(
        self, tracker: Tracker, view_of: Callable[[str], RunView], log: Callable[[str], None]
    ) -> None:
        self.tracker = tracker
        self._view_of = view_of
        self._log = log
        self._marked: dict[str, None] = {}  # ordered: parents are marked before children
        self._change = threading.Condition()
        self._showing: set[str] = set()
        self._closing = False
        self._away = False
        self._given_up = False
        self._shows = 0  # that MLflow has taken so far
        self._failed: dict[str, int] = {}  # runs that it has not taken, and shows until then
        self._refused: set[str] = set()  # those of them that are not tried again by themselves
        self._told: set[str] = set()
        self._thread = threading.Thread(target=self._run, name="mirror", daemon=True)
        self._thread.start()

    def mark(self, keys: Iterable[str]) -> None:
        """Mark runs that have changed on disk."""
        with self._change:
            self._marked.update(dict.fromkeys(keys))
            self._change.notify()

    def close(self) -> int:
        """Write the marked runs and end; return the number of runs that could not be written."""
        with self._change:
            self._closing = True
            self._change.notify()
        begun = time.monotonic()
        while self._thread.is_alive():
            patience = _PATIENCE_AWAY if self._away else _PATIENCE
            if time.monotonic() - begun > patience:
                self._given_up = True
                break
            self._thread.join(0.1)
        return len({*self._marked, *self._showing, *self._refused})

    def _run(self) -> None:
        retry = _FIRST_RETRY
        while True:
            with self._change:
                self._change.wait_for(lambda: self._marked or self._closing)
                keys = list(self._marked)
            if not keys or self._given_up:
                return
            try:
                for key in keys:
                    self._show(key)
            except Exception as error:  # whatever MLflow raises, the study continues
                self.tracker.forget()
                if not self._away:
                    self._away = True
                    self._log(
                        f"MLflow at {without_password(self.tracker.uri)} is unreachable "
                        f"({without_password(first_line(error))}): the "
                        "run continues, and missing data is written once MLflow is back"
                    )
                with self._change:
                    if self._change.wait_for(lambda: self._closing, retry):
                        time.sleep(_FIRST_RETRY)
                retry = min(2 * retry, _LAST_RETRY)
            else:
                retry = _FIRST_RETRY

    def _show(self, key: str) -> None:
        with self._change:
            self._marked.pop(key, None)  # a mark set while it is being shown counts again
            self._showing = {key}
        try:
            view = self._view_of(key)
        except Exception as error:  # an error of the disk, not of MLflow: skip this run
            self._log_once(f"{first_line(error)}; MLflow does not show it")
            self._showing = set()
            return
        try:
            self.tracker.show(view)
        except DocumentFailed as error:
            self._log_once(f"{view.name}: MLflow lacks {error}")
        except Exception as error:
            before = self._failed.get(key)
            self._failed[key] = self._shows
            if before is not None and before < self._shows:
                # MLflow took others meanwhile: it is this one that it does not take.
                told = without_password(first_line(error))
                self._log_once(f"{view.name}: MLflow does not take the run ({told})")
                self._showing = set()
                self._refused.add(key)
                self.tracker.forget()
                return
            with self._change:
                if before is None:
                    self._marked = {key: None, **self._marked}  # before its children
                else:
                    self._marked[key] = None  # after all others, to see whether MLflow takes them
            raise
        self._shows += 1
        self._failed.pop(key, None)
        self._refused.discard(key)
        self._showing = set()
        if self._away and not self._given_up:
            self._away = False
            self._log("MLflow is reachable again and catches up")

    def _log_once(self, line: str) -> None:
        if line not in self._told:
            self._told.add(line)
            self._log(line)
