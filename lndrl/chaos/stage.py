"""The processes of a chaos run, started by their command lines as users start them.

One learner, honest actors each behind a proxy of its own, a rogue, a dashboard, and now and then a
second run. Every process leads a session of its own, so that whatever happens to this one, all
that they started can be ended with them.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import yaml

from lndrl.chaos.proxy import Proxy
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.ports import free_port
from lndrl.machine.processes import descendants, lives
from lndrl.numbering import by_number

__all__ = ["CONFIG", "Child", "Stage", "descendants", "is_worker", "lives", "wait_for"]

RUN, SIDE_RUN = "chaos", "side"
UPLOAD_TIMEOUT = 4.0
"""s; short, so that a stall beyond every timeout takes seconds."""

CONFIG: dict[str, Any] = {
    "scenario": "hybrid",
    "network": {"map_channels": [4, 4, 8], "features": 16, "goal_features": 8},
    "ppo": {"batch_size": 128, "minibatch_size": 64, "epochs": 1},
    "learner": {"total_steps": 10**9, "checkpoint_interval": 5, "threads": 1, "max_lag": 8},
    "actor": {"count": 1, "worlds": 2, "horizon": 16},
    "localization": {"min_particles": 100, "max_particles": 200},
    "transport": {"upload_timeout": UPLOAD_TIMEOUT},
}
"""A run that updates several times a second on one core, so that every fault meets a busy one."""

LEAVE_WITHIN = 15.0  # s that an asked process may take
Result = TypeVar("Result")


class Child:
    """One process of ``lndrl`` or of this room, with a log; can be started again."""

    def __init__(self, name: str, command: list[str], folder: Path) -> None:
        self.name, self.command, self.folder = name, command, folder
        self.starts = 0
        self.process: subprocess.Popen[bytes] | None = None
        self._environment = this_program() | {"OMP_NUM_THREADS": "1"}

    @property
    def log_path(self) -> Path:
        """Where all that it says goes."""
        return self.folder / f"{self.name}.log"

    def start(self, *more: str) -> None:
        """Start it, with ``more`` arguments this time."""
        self.starts += 1
        with self.log_path.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", *self.command, *more],
                cwd=self.folder,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Of the newest process; 0 before the first."""
        return self.process.pid if self.process is not None else 0

    def alive(self) -> bool:
        """Whether it runs (or is stopped by a signal)."""
        return self.process is not None and self.process.poll() is None

    def send(self, number: signal.Signals) -> None:
        """A signal to the process alone."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(number)

    def wait(self, seconds: float) -> bool:
        """Whether it has ended within ``seconds``."""
        try:
            if self.process is not None:
                self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    def kill(self) -> None:
        """End it and all that it started, now; can be called twice."""
        if self.process is None:
            return
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def log(self) -> str:
        """All that it said so far."""
        return (
            self.log_path.read_text(errors="replace", encoding="utf-8")
            if self.log_path.exists()
            else ""
        )

    def tail(self, letters: int = 1500) -> str:
        """The end of the log."""
        return self.log()[-letters:]


class Stage:
    """All processes of a chaos run in ``folder``; ``close`` leaves none of them.

    ``actors`` honest fleets of one actor each; ``rogue`` adds one that sends badly, by ``seed``.
    """

    def __init__(
        self,
        folder: Path,
        actors: int = 2,
        seed: int = 0,
        rogue: bool = True,
        config: dict[str, Any] | None = None,
    ) -> None:
        self.folder = folder
        self.children: list[Child] = []
        self.proxies: list[Proxy] = []
        self._config = config or CONFIG
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "chaos.yaml").write_text(yaml.safe_dump(self._config), encoding="utf-8")
        self.port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self.learner = self._learner(RUN, self.endpoint)
        self.actors = [self._actor(f"actor-{i}", self._proxy().endpoint) for i in range(actors)]
        self.rogue = self._rogue("rogue", seed, self._proxy().endpoint) if rogue else None
        self.old = self._rogue("old", seed, self.endpoint, "--keep-weights", "--share", "0")
        watching = ["lndrl", "dashboard", "--connect", self.endpoint, "--json"]
        self.dashboard = self._child("dashboard", watching)
        side = f"tcp/127.0.0.1:{free_port()}"
        self.side_learner = self._learner(SIDE_RUN, side)
        self.side_actor = self._actor("side-actor", side)

    # -- files -------------------------------------------------------------------------------

    def run_folder(self, run: str = RUN) -> Path:
        """Where a learner keeps its run."""
        return self.folder / "runs" / run

    def learner_ledger(self, run: str = RUN) -> Path:
        """What a learner wrote down."""
        return self.run_folder(run) / "ledger.jsonl"

    def actor_ledgers(self, run: str = RUN) -> list[Path]:
        """What the actors of a run wrote down."""
        paths = sorted(self.folder.glob("*.ledger.jsonl"), key=by_number)
        return [path for path in paths if path.name.startswith("side-") == (run == SIDE_RUN)]

    def ledger_for(self, name: str) -> Path:
        """Where an actor of that name writes."""
        return self.folder / f"{name}.ledger.jsonl"

    # -- starting ----------------------------------------------------------------------------

    def start_learner(self, learner: Child | None = None) -> None:
        """Start a learner, from its newest checkpoint where its run exists."""
        learner = learner or self.learner
        run = RUN if learner is self.learner else SIDE_RUN
        exists = (self.run_folder(run) / "run.json").exists()
        learner.start(*(["--resume"] if exists else []))

    def everyone(self) -> list[Child]:
        """The actors of the main run that are there from the beginning."""
        return [*self.actors, *([self.rogue] if self.rogue is not None else [])]

    def workers(self, fleet: Child) -> list[int]:
        """Process ids of a fleet's workers; of a single actor its own."""
        if "actor" not in fleet.command:
            return [fleet.pid] if fleet.alive() else []
        return [pid for pid in descendants(fleet.pid) if is_worker(pid)]

    # -- the end -----------------------------------------------------------------------------

    def finish(self) -> list[str]:
        """Ask everybody to leave, actors first; returns who had to be killed."""
        late = []
        for group in (
            [*self.everyone(), self.old, self.side_actor, self.dashboard, *self._others()],
            [self.learner, self.side_learner],
        ):
            for child in group:
                child.send(signal.SIGCONT)
                child.send(signal.SIGINT)
            deadline = time.monotonic() + LEAVE_WITHIN
            for child in group:
                if not child.wait(max(0.1, deadline - time.monotonic())):
                    late.append(child.name)
                child.kill()
        return late

    def close(self) -> None:
        """End every process and proxy that is left; can be called twice."""
        for child in self.children:
            child.kill()
        for proxy in self.proxies:
            proxy.close()

    def add(self, name: str, command: list[str]) -> Child:
        """One more process of the main run, started at once."""
        child = self._child(name, command)
        child.start()
        return child

    # -- making ------------------------------------------------------------------------------

    def _child(self, name: str, command: list[str]) -> Child:
        child = Child(name, command, self.folder)
        self.children.append(child)
        return child

    def _others(self) -> list[Child]:
        named = [self.learner, self.side_learner, self.side_actor, self.old, self.dashboard]
        return [c for c in self.children if c not in named and c not in self.everyone()]

    def _proxy(self) -> Proxy:
        proxy = Proxy(("127.0.0.1", self.port))
        self.proxies.append(proxy)
        return proxy

    def _learner(self, run: str, endpoint: str) -> Child:
        command = ["lndrl", "learner", "chaos.yaml", "--listen", endpoint, "--run", run]
        return self._child(f"learner-{run}", command)

    def _actor(self, name: str, endpoint: str) -> Child:
        command = ["lndrl", "actor", "--connect", endpoint]
        return self._child(name, [*command, "--ledger", str(self.ledger_for(name))])

    def _rogue(self, name: str, seed: int, endpoint: str, *more: str) -> Child:
        command = ["lndrl.chaos.rogue", "--connect", endpoint, "--seed", str(seed)]
        command += ["--ledger", str(self.ledger_for(name))]
        command += ["--counts", str(self.folder / f"{name}.counts.json"), *more]
        return self._child(name, command)


def wait_for(
    what: str, look: Callable[[], Result], seconds: float, stopped: Callable[[], bool] = bool
) -> Result:
    """The first true answer of ``look``; raises TimeoutError, InterruptedError when stopped."""
    deadline = time.monotonic() + seconds
    while not (found := look()):
        if stopped():
            raise InterruptedError(what)
        if time.monotonic() > deadline:
            raise TimeoutError(f"no {what} within {seconds:g} s")
        time.sleep(0.1)
    return found


def is_worker(pid: int) -> bool:
    """Whether a process is an actor that a fleet started."""
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
