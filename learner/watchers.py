"""Who looks on beside a learner: Prometheus, and ``lndrl log --follow`` in processes of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Thread

from learner.learner import Learner
from learner.monitor import Monitor
from learner.run.events import EventLog
from learner.status import StatusThread

_PATIENCE = 30.0  # s for the last rows, when the learner leaves
_SAID = (0, 2)  # exit codes of a child that has said itself what became of them
_LONGEST = 400  # letters of a line


class Trackers:
    """One process for each of ``names``; what they say is an event of the run.

    They read the run's folder and know nothing of the learner, which waits for them only at its
    end, for ``_PATIENCE`` seconds at most.
    """

    def __init__(self, names: Sequence[str], folder: Path, events: EventLog) -> None:
        self._folder, self._events = folder, events
        self._children: dict[str, subprocess.Popen[str]] = {}
        self._relays: list[Thread] = []
        for name in names:
            try:
                self._children[name] = self._start(name)
            except OSError as error:
                events.add("log", f"{name}: cannot be started ({error.strerror})")

    def close(self) -> None:
        """Let them send what is left, and end them; call it before the events are closed."""
        for child in self._children.values():
            with suppress(ProcessLookupError):
                child.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + _PATIENCE
        for name, child in self._children.items():
            with suppress(subprocess.TimeoutExpired):
                child.wait(max(0.1, deadline - time.monotonic()))
            if child.returncode not in _SAID:
                again = f"lndrl log {self._folder} --to {name} sends the rest"
                self._events.add("log", f"{name}: has not taken everything; {again}")
            # The tool's own processes, too: they are of the child's session.
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
        for relay in self._relays:
            relay.join(1.0)
        self._children, self._relays = {}, []

    def _start(self, name: str) -> subprocess.Popen[str]:
        # Where this program is a checkout, its children must find it, too.
        root = str(Path(__file__).resolve().parents[1])
        paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
        command = ["-m", "lndrl", "log", str(self._folder), "--to", name, "--follow"]
        child = subprocess.Popen(
            [sys.executable, *command],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C is for the learner, which then lets them end
        )
        relay = Thread(target=self._relay, args=(name, child), name=f"log {name}", daemon=True)
        relay.start()
        self._relays.append(relay)
        return child

    def _relay(self, name: str, child: subprocess.Popen[str]) -> None:
        assert child.stdout is not None
        for line in child.stdout:
            text = line.strip()[:_LONGEST]
            if text and not text.startswith("stopping: "):
                self._events.add("log", f"{name}: {text.removeprefix('lndrl: ')}")


class Watchers:
    """Who looks on from beside a learner: Prometheus, where it is asked for, and trackers."""

    def __init__(self, trackers: Sequence[str]) -> None:
        self._names = trackers
        self._monitor: Monitor | None = None
        self._trackers: Trackers | None = None

    def listen(self, metrics: tuple[str, int] | None) -> None:
        """Take the port of ``metrics`` (address, port); raises UserError."""
        self._monitor = Monitor(*metrics) if metrics is not None else None

    def begin(self, learner: Learner, status: StatusThread) -> None:
        """Look on from now."""
        if self._monitor is not None:
            self._monitor.follow(status)
            learner.events.add("listen", f"metrics at {self._monitor.url}")
        self._trackers = Trackers(self._names, learner.folder.path, learner.events)

    def end(self) -> None:
        """The training is over: let trackers have the last rows; can be called twice."""
        if self._trackers is not None:
            self._trackers.close()

    def close(self) -> None:
        """Give the port back."""
        if self._monitor is not None:
            self._monitor.close()
