"""What operators ask of a run: noted on the transport's thread, done between two updates."""

from __future__ import annotations

from threading import Event, Lock

from learner.run.events import EventLog
from lndrl.transport.messages import Refusal
from lndrl.transport.operation import CHECKPOINT, Granted, Request


class Orders:
    """The open requests of one run. Thread-safe; every request is an event of the run's log."""

    def __init__(self, run_id: str, events: EventLog) -> None:
        self._run_id, self._events = run_id, events
        self._lock = Lock()
        self._stop: Event | None = None
        self._checkpoint = False

    def heed(self, stop: Event) -> None:
        """From now on requests are granted; ``stop`` ends the run in an orderly way."""
        with self._lock:
            self._stop = stop

    def ignore(self) -> None:
        """The run is ending: whatever is asked now comes too late."""
        with self._lock:
            self._stop = None

    def on_request(self, request: Request) -> Granted | Refusal:
        """See ``OperatorHandlers``."""
        answer = self._answer(request)
        word = "refused" if isinstance(answer, Refusal) else "granted"
        said = answer.reason if isinstance(answer, Refusal) else answer.sentence
        who = request.sender or "somebody"
        self._events.add("operator", f"{who} asks for a {request.action}: {word}, {said}")
        return answer

    def checkpoint_due(self) -> bool:
        """Whether a checkpoint was asked for since the last call."""
        with self._lock:
            due, self._checkpoint = self._checkpoint, False
        return due

    def _answer(self, request: Request) -> Granted | Refusal:
        with self._lock:
            if request.run_id != self._run_id:
                return Refusal("another run is at this address by now; look again")
            if self._stop is None:
                return Refusal("the run has not begun or is ending already")
            if request.action == CHECKPOINT:
                self._checkpoint = True
                return Granted("a checkpoint follows the update at work")
            if self._stop.is_set():
                return Refusal("the run is stopping already")
            self._stop.set()
            return Granted(
                "the run stops after the update at work, leaves a checkpoint and can be resumed"
            )
