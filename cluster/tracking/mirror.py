"""Keeps MLflow up to date with the disk, in its own thread.

The disk is the truth. A running study marks runs that have changed, and appends the points of new
generations; neither waits for MLflow. While MLflow is unreachable, the study continues, and the
runs are read from disk afterwards.
"""

import threading
import time
from collections.abc import Callable, Iterable, Sequence

from bilevel.errors import InvalidInput, first_line
from cluster.storage.author import without_password
from cluster.tracking.tracker import Tracker
from cluster.tracking.view import Point, RunView

#: First and longest delay in seconds between attempts to reach MLflow; the delay doubles.
_FIRST_RETRY, _LAST_RETRY = 1.0, 30.0
#: Seconds for which `close` waits if MLflow answers, and if it is unreachable.
_TIMEOUTS = (120.0, 10.0)


class Mirror:
    """Writes runs to MLflow, in the order in which they change.

    `view_of` builds the complete view of a run from disk, in the mirror's thread. `log` gets a line
    when MLflow becomes unreachable or reachable again, and for runs that cannot be shown.
    """

    def __init__(
        self, tracker: Tracker, view_of: Callable[[str], RunView], log: Callable[[str], None]
    ) -> None:
        self.tracker = tracker
        self._view_of = view_of
        self._log = log
        #: New points by key, in order; None for a complete view.
        self._pending: dict[str, list[Point] | None] = {}
        self._writing: set[str] = set()
        self._failed: dict[str, str] = {}  # errors by key
        self._changed = threading.Condition()
        self._closing = self._timed_out = self._unreachable = False
        self._thread = threading.Thread(target=self._run, name="mirror", daemon=True)
        self._thread.start()

    def mark(self, keys: Iterable[str]) -> None:
        """Show runs completely, from their files."""
        with self._changed:
            self._pending.update(dict.fromkeys(keys))
            self._changed.notify()

    def append(self, key: str, points: Sequence[Point]) -> None:
        """Add points to a run. Its files are read only if MLflow may lack more than these."""
        with self._changed:
            waiting = self._pending.setdefault(key, None if self._unreachable else [])
            if waiting is not None:
                waiting.extend(points)
            self._changed.notify()

    def close(self) -> int:
        """Write all changes and end; return the number of runs that MLflow lacks in part."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        started = time.monotonic()
        while self._thread.is_alive() and not self._timed_out:
            self._thread.join(0.1)
            waited = time.monotonic() - started
            self._timed_out = waited > _TIMEOUTS[self._unreachable]
        return len({*self.waiting, *self._failed})

    @property
    def waiting(self) -> set[str]:
        """Keys of the runs with changes that are not written yet."""
        with self._changed:
            return {*self._pending, *self._writing}

    def _run(self) -> None:
        delay = _FIRST_RETRY
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._pending or self._closing)
                if not self._pending or self._timed_out:
                    return
                key = next(iter(self._pending))
                points = self._pending.pop(key)
                self._writing = {key}
            try:
                if points is None or not self.tracker.append(key, points):
                    self._show(key)
                delay = _FIRST_RETRY
                self._writing = set()
            except Exception as error:  # whatever MLflow raises, the study continues
                self._retry_later(key, error, delay)
                delay = min(2 * delay, _LAST_RETRY)

    def _show(self, key: str) -> None:
        """Write the complete view of a run. An error of the run itself is logged once."""
        earlier = self._failed.pop(key, None)
        try:
            self.tracker.show(self._built(key))
        except InvalidInput as error:
            self._failed[key] = str(error)
            if str(error) != earlier:
                self._log(str(error))
        if self._unreachable and not self._timed_out:
            self._unreachable = False
            self._log("MLflow is reachable again and catches up")

    def _built(self, key: str) -> RunView:
        """Return the view of a run. Raises InvalidInput, because an error is one of the run."""
        try:
            return self._view_of(key)
        except Exception as error:
            if isinstance(error, InvalidInput):
                raise
            raise InvalidInput(f"cannot show a run: {type(error).__name__}: {error}") from None

    def _retry_later(self, key: str, error: Exception, delay: float) -> None:
        """Wait, then show this run and all waiting ones completely."""
        self.tracker.forget()
        if not self._unreachable:
            self._log(
                f"MLflow at {without_password(self.tracker.uri)} is unreachable "
                f"({without_password(first_line(error))}): the run continues, and missing data is "
                "written once MLflow is back"
            )
        with self._changed:
            self._unreachable = True
            self._pending = dict.fromkeys([key, *self._pending])  # parents stay before children
            closing = self._changed.wait_for(lambda: self._closing, delay)
        if closing:
            time.sleep(_FIRST_RETRY)
