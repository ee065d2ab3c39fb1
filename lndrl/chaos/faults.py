"""What each kind of fault does to the processes of a stage, and how it is mended again.

Nothing here waits: ``begin`` strikes, ``end`` mends, ``poll`` looks after what comes later.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lndrl.chaos.bystanders import Bystanders
from lndrl.chaos.monitor import Monitor
from lndrl.chaos.schedule import GUARD, KINDS, LEARNER, Fault
from lndrl.chaos.stage import LEAVE_WITHIN, Child, Stage, lives

DELAY = 0.3  # s, each way
STORM_ACTORS = 300
ORPHAN_SECONDS = 8.0
"""s in which a worker must have noticed that its fleet was killed."""

MOST_DEATHS = 5
MARGIN = 8192  # bytes that the log of a learner on a full disk may still grow by


@dataclass
class Freeze:
    """A frozen actor that the status has yet to show as something other than active."""

    pid: int
    since: float
    until: float


@dataclass
class Findings:
    """What was seen beside the ledgers."""

    struck: Counter[str] = field(default_factory=Counter)
    missed: Counter[str] = field(default_factory=Counter)
    recoveries: list[float] = field(default_factory=list)
    frozen_shown: list[float] = field(default_factory=list)
    frozen_unseen: int = 0
    others_while_frozen: list[float] = field(default_factory=list)  # rates over those before
    deaths: list[str] = field(default_factory=list)  # the learner's own, with its last words
    gave_up: list[str] = field(default_factory=list)  # actors that ended by themselves
    orphans: int = 0
    storms: list[dict[str, Any]] = field(default_factory=list)


class Injector:
    """Strikes and mends; ``poll`` it often. Starts again what dies, as a supervisor would."""

    def __init__(self, stage: Stage, monitor: Monitor) -> None:
        self.stage, self.monitor = stage, monitor
        self.found = Findings()
        self._killed: set[str] = set()  # names of children that died by this hand
        self._recovering: list[tuple[float, float]] = []  # killed at, updates count from
        self._freezes: list[Freeze] = []
        self._orphans: list[tuple[int, float]] = []
        self._leaving: list[tuple[Child, float]] = []
        self._storms: list[Child] = []
        self._frozen: dict[str, int] = {}
        self._bystanders = Bystanders(monitor)
        self._calm_from = 0.0
        self._side_wanted = False
        self._limits: tuple[int, int] | None = None

    def begin(self, fault: Fault) -> bool:
        """Let ``fault`` strike; False when there was nothing to strike.

        A learner that has yet to come back from the last kill is left alone: one that is killed
        while it still starts shows nothing new, and on a slow machine would never train.
        """
        if KINDS[fault.kind].lane == LEARNER:
            if self._recovering:
                self.found.missed[fault.kind] += 1
                return False
            self._calm_from = time.monotonic() + fault.duration + GUARD
        struck = getattr(self, f"_{fault.kind}")(fault) is not False
        if struck and fault.kind != "actor_freeze":
            self._bystanders.disturbed(time.monotonic(), fault.duration + GUARD)
        (self.found.struck if struck else self.found.missed)[fault.kind] += 1
        return struck

    def end(self, fault: Fault) -> None:
        """Mend it; does nothing where it mends itself."""
        mend = getattr(self, f"_end_{fault.kind}", None)
        if mend is not None:
            mend(fault)

    def poll(self) -> None:
        """Take note of what has happened, and start again what has died."""
        now = time.monotonic()
        self._look_after_learner()
        for child in self.stage.everyone():
            if child.starts and not child.alive():
                if child.name not in self._killed:
                    self.found.gave_up.append(f"{child.name}: {child.tail(300)}")
                self._killed.discard(child.name)
                child.start()
        self._look_after_side()
        for killed, since in list(self._recovering):
            seen = self.monitor.updated_since(since)
            if seen is not None:
                self.found.recoveries.append(seen - killed)
                self._bystanders.disturbed(killed, seen - killed + GUARD)
                self._recovering.remove((killed, since))
        self._look_for_frozen(now)
        self.found.orphans += sum(now > end and lives(pid) for pid, end in self._orphans)
        self._orphans = [(p, end) for p, end in self._orphans if now <= end and lives(p)]
        for child, deadline in list(self._leaving):
            if not child.alive() or now > deadline:
                child.kill()
                self._leaving.remove((child, deadline))
        for storm in [storm for storm in self._storms if not storm.alive()]:
            self._storms.remove(storm)
            self._read_storm(storm)

    def recovering(self) -> bool:
        """Whether a killed learner has not yet made an update."""
        return bool(self._recovering)

    def mend_all(self) -> None:
        """Take every fault away."""
        for proxy in self.stage.proxies:
            proxy.mend()
        for child in self.stage.children:
            child.send(signal.SIGCONT)
        for pid in self._frozen.values():
            _signal(pid, signal.SIGCONT)
        self._end_disk_full(None)
        self._end_read_only(None)
        self._side_wanted = False

    # -- actors ------------------------------------------------------------------------------

    def _fleet(self, fault: Fault) -> tuple[int, Child, int]:
        """Number of an actor, its fleet, and the process id of its worker or 0."""
        number = int(fault.target.rpartition("-")[2])
        fleet = self.stage.actors[number]
        return number, fleet, next(iter(self.stage.workers(fleet)), 0)

    def _actor_kill(self, fault: Fault) -> bool:
        _, _, pid = self._fleet(fault)
        return pid != 0 and _signal(pid, signal.SIGKILL)

    def _actor_freeze(self, fault: Fault) -> bool:
        _, _, pid = self._fleet(fault)
        shown = self.monitor.state_of(pid) == "active"
        if not pid or not _signal(pid, signal.SIGSTOP):
            return False
        self._frozen[fault.target] = pid
        now = time.monotonic()
        if shown and now > self._calm_from:
            self._freezes.append(Freeze(pid, now, now + fault.duration))
        others = [w for a in self.stage.actors for w in self.stage.workers(a) if w != pid]
        self._bystanders.frozen(fault.target, others)
        return True

    def _end_actor_freeze(self, fault: Fault) -> None:
        ratio = self._bystanders.thawed(fault.target)
        if ratio is not None and not self._recovering:
            self.found.others_while_frozen.append(ratio)
        _signal(self._frozen.pop(fault.target, 0), signal.SIGCONT)

    def _fleet_kill(self, fault: Fault) -> bool:
        _, fleet, pid = self._fleet(fault)
        if not fleet.alive():
            return False
        self._killed.add(fleet.name)
        fleet.send(signal.SIGKILL)
        if pid:
            self._orphans.append((pid, time.monotonic() + ORPHAN_SECONDS))
        return True

    def _old_weights(self, fault: Fault) -> bool:
        if self.stage.old.alive():
            return False
        self.stage.old.start()
        return True

    def _end_old_weights(self, fault: Fault) -> None:
        self._ask_to_leave(self.stage.old)

    def _join_storm(self, fault: Fault) -> None:
        command = ["lndrl.chaos.storm", "--connect", self.stage.endpoint]
        command += ["--actors", str(STORM_ACTORS), "--seconds", str(fault.duration)]
        command += ["--ledger", str(self.stage.ledger_for("storm"))]
        name = f"storm-{self.found.struck['join_storm']}"
        self._storms.append(self.stage.add(name, command))

    # -- the network -------------------------------------------------------------------------

    def _proxy_delay(self, fault: Fault) -> None:
        self.stage.proxies[self._fleet(fault)[0]].delay(DELAY)

    def _proxy_cut(self, fault: Fault) -> None:
        self.stage.proxies[self._fleet(fault)[0]].cut()

    def _proxy_stall(self, fault: Fault) -> None:
        self.stage.proxies[self._fleet(fault)[0]].stall()

    def _mend_proxy(self, fault: Fault) -> None:
        self.stage.proxies[self._fleet(fault)[0]].mend()

    _end_proxy_delay = _end_proxy_cut = _end_proxy_stall = _mend_proxy

    def _router_restart(self, fault: Fault) -> None:
        for proxy in self.stage.proxies:
            proxy.cut()

    def _end_router_restart(self, fault: Fault) -> None:
        for proxy in self.stage.proxies:
            proxy.mend()

    # -- the learner -------------------------------------------------------------------------

    def _learner_kill(self, fault: Fault) -> bool:
        learner = self.stage.learner
        if not learner.alive():
            return False
        killed = time.monotonic()
        learner.send(signal.SIGKILL)
        learner.wait(5.0)
        self.monitor.look()  # what it wrote before it died is no recovery
        self._recovering.append((killed, time.monotonic()))
        self._start_learner()
        return True

    def _learner_freeze(self, fault: Fault) -> None:
        self.stage.learner.send(signal.SIGSTOP)

    def _end_learner_freeze(self, fault: Fault) -> None:
        self.stage.learner.send(signal.SIGCONT)

    _learner_stall, _end_learner_stall = _learner_freeze, _end_learner_freeze

    def _disk_full(self, fault: Fault) -> bool:
        """No file of the learner may grow beyond its log: what a full disk does, without root.

        Python ignores SIGXFSZ, so a write beyond the limit is an OSError, as on a full disk.
        """
        learner = self.stage.learner
        if not learner.alive():
            return False
        self._limits = resource.prlimit(learner.pid, resource.RLIMIT_FSIZE)
        soft = len(learner.log().encode()) + MARGIN
        resource.prlimit(learner.pid, resource.RLIMIT_FSIZE, (soft, self._limits[1]))
        return True

    def _end_disk_full(self, fault: Fault | None) -> None:
        if self._limits is not None:
            with suppress(OSError):
                resource.prlimit(self.stage.learner.pid, resource.RLIMIT_FSIZE, self._limits)
        self._limits = None

    def _read_only(self, fault: Fault) -> bool:
        """No checkpoint can be made: a file stands where their folder was.

        Taking the permission away would not hinder root.
        """
        folder = self.stage.run_folder() / "checkpoints"
        if not folder.is_dir():
            return False
        folder.rename(_aside(folder))
        folder.write_text("", encoding="utf-8")
        return True

    def _end_read_only(self, fault: Fault | None) -> None:
        folder = self.stage.run_folder() / "checkpoints"
        if _aside(folder).is_dir():
            folder.unlink(missing_ok=True)
            _aside(folder).rename(folder)

    # -- others ------------------------------------------------------------------------------

    def _dashboard_freeze(self, fault: Fault) -> bool:
        self.stage.dashboard.send(signal.SIGSTOP)
        return self.stage.dashboard.alive()

    def _end_dashboard_freeze(self, fault: Fault) -> None:
        self.stage.dashboard.send(signal.SIGCONT)

    def _second_run(self, fault: Fault) -> bool:
        if self.stage.side_learner.alive():
            return False
        self.stage.start_learner(self.stage.side_learner)
        self._side_wanted = True
        return True

    def _end_second_run(self, fault: Fault) -> None:
        self._side_wanted = False
        self._ask_to_leave(self.stage.side_actor)
        self._ask_to_leave(self.stage.side_learner)

    # -- looking after -----------------------------------------------------------------------

    def _ask_to_leave(self, child: Child) -> None:
        child.send(signal.SIGINT)
        self._leaving.append((child, time.monotonic() + LEAVE_WITHIN))

    def _start_learner(self) -> None:
        self.stage.start_learner()
        self.monitor.learner_started(self.stage.learner.pid)

    def _look_after_learner(self) -> None:
        learner = self.stage.learner
        if learner.alive():
            return
        assert learner.process is not None
        words = f"exit code {learner.process.returncode}: {learner.tail()}"
        self.found.deaths.append(words)
        if len(self.found.deaths) >= MOST_DEATHS:
            raise RuntimeError(f"the learner died {MOST_DEATHS} times of itself")
        self._end_disk_full(None)
        self._end_read_only(None)
        self._start_learner()

    def _look_after_side(self) -> None:
        learner, actor = self.stage.side_learner, self.stage.side_actor
        if not self._side_wanted or actor.alive():
            return
        if not learner.alive():
            self.found.deaths.append(f"second run: {learner.tail()}")
            self._side_wanted = False
        elif learner.log().count("[listen]") >= learner.starts:
            actor.start()

    def _look_for_frozen(self, now: float) -> None:
        for freeze in list(self._freezes):
            if self.monitor.state_of(freeze.pid) != "active":
                self.found.frozen_shown.append(now - freeze.since)
            elif now < freeze.until:
                continue
            elif freeze.since > self._calm_from or now > self._calm_from:
                self.found.frozen_unseen += 1
            self._freezes.remove(freeze)

    def _read_storm(self, storm: Child) -> None:
        for line in storm.log().splitlines():
            if line.startswith("{"):
                self.found.storms.append(json.loads(line))


def _aside(folder: Path) -> Path:
    return folder.with_name(folder.name + ".aside")


def _signal(pid: int, number: signal.Signals) -> bool:
    """Whether the signal could be sent."""
    try:
        if pid:
            os.kill(pid, number)
    except ProcessLookupError:
        return False
    return pid != 0
