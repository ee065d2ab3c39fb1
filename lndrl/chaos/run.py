"""One chaos run: start a stage, let a schedule strike it, end it, balance the books."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any

from lndrl.chaos.faults import Injector
from lndrl.chaos.ledger import ActorBook, Balance, LearnerBook, balance, files_of, lines_of
from lndrl.chaos.monitor import Monitor
from lndrl.chaos.report import ChaosReport, make_report
from lndrl.chaos.schedule import Fault, schedule
from lndrl.chaos.stage import RUN, SIDE_RUN, Stage, wait_for

STARTING = 600.0
"""s that the first update may take; a fresh installation compiles for minutes."""

SETTLING = 180.0
"""s after the last fault in which a killed learner may still recover; slow machines need them."""

BEAT = 0.1


@dataclass(frozen=True)
class ChaosOptions:
    """What to do: see ``lndrl chaos --help``."""

    minutes: float
    seed: int = 1
    actors: int = 2
    pace: float = 12.0
    kinds: Collection[str] | None = None
    rogue: bool = True
    config: dict[str, Any] | None = None


def run_chaos(
    options: ChaosOptions,
    folder: Path,
    stop: Event | None = None,
    show: Callable[[str], None] = lambda line: None,
) -> ChaosReport:
    """Run it in ``folder``; ``stop`` ends it early, with a report of what was.

    ``show`` hears a line several times a second. No process is left behind, whatever is raised:
    TimeoutError when training does not begin, RuntimeError when the learner keeps dying.
    """
    stop = stop or Event()
    plan = schedule(options.seed, options.minutes, options.actors, options.pace, options.kinds)
    stage = Stage(folder.resolve(), options.actors, options.seed, options.rogue, options.config)
    monitor = Monitor(stage.learner_ledger(), stage.endpoint)
    try:
        show("starting")
        start(stage, monitor, stop)
        injector = Injector(stage, monitor)
        began = time.monotonic()
        _strike(plan, options.minutes, injector, stop, show)
        minutes = (time.monotonic() - began) / 60.0
        injector.mend_all()
        _settle(injector, stop)
        show("ending")
        late = stage.finish()
        injector.found.orphans += sum(child.alive() for child in stage.children)
    finally:
        monitor.close()
        stage.close()
    return make_report(
        options.seed,
        minutes,
        injector.found,
        monitor,
        balance_of(stage, RUN),
        balance_of(stage, SIDE_RUN) if stage.run_folder(SIDE_RUN).exists() else None,
        misbehaved=_misbehaved(folder),
        learner_starts=stage.learner.starts,
        checkpoints_refused=_events(stage).count(" disk "),
        tracebacks=stage.learner.log().count("Traceback"),
        late=late,
    )


def start(stage: Stage, monitor: Monitor, stop: Event) -> None:
    """Start everybody; returns when all deliver. Raises TimeoutError, InterruptedError."""
    stage.start_learner()
    monitor.learner_started(stage.learner.pid)

    def look(done: Callable[[], bool]) -> Callable[[], bool]:
        def looked() -> bool:
            monitor.look()
            if not stage.learner.alive():
                raise RuntimeError(f"the learner ended at once: {stage.learner.tail()}")
            return done()

        return looked

    def waiting(what: str, done: Callable[[], bool]) -> None:
        try:
            wait_for(what, look(done), STARTING, stop.is_set)
        except TimeoutError as error:
            logs = "\n".join(f"{c.name}: {c.tail(500)}" for c in stage.children if c.starts)
            raise TimeoutError(f"{error}; {logs}") from None

    waiting("open port", lambda: "[listen]" in stage.learner.log())
    first, *others = stage.everyone()
    first.start()  # compiles what a fresh installation lacks; the others find it compiled
    waiting("update", lambda: monitor.trained > 0)
    for child in others:
        child.start()
    stage.dashboard.start()
    waiting("actors", lambda: len(monitor.accepted) >= 1 + len(others))


def balance_of(stage: Stage, run: str) -> Balance:
    """The balance of a run's books."""
    ledger = stage.learner_ledger(run)
    learner = LearnerBook().read(lines_of(*files_of(ledger)))
    return balance(learner, ActorBook().read(lines_of(*stage.actor_ledgers(run))))


def _strike(
    plan: list[Fault],
    minutes: float,
    injector: Injector,
    stop: Event,
    show: Callable[[str], None],
) -> None:
    """Let every fault begin and end in time, until the time is over."""
    moments = [(fault.time, 1, fault) for fault in plan]
    moments += [(fault.time + fault.duration, 0, fault) for fault in plan if fault.duration]
    moments.sort(key=lambda moment: moment[:2])
    began = time.monotonic()
    struck: set[Fault] = set()
    while not stop.is_set() and (now := time.monotonic() - began) < 60.0 * minutes:
        while moments and moments[0][0] <= now:
            _, begins, fault = moments.pop(0)
            if begins:
                if injector.begin(fault):
                    struck.add(fault)
            elif fault in struck:
                injector.end(fault)
        injector.monitor.look()
        injector.poll()
        show(_line(now, minutes, injector, plan))
        stop.wait(BEAT)


def _settle(injector: Injector, stop: Event) -> None:
    """Let a learner that was just killed come back."""
    deadline = time.monotonic() + SETTLING
    while injector.recovering() and time.monotonic() < deadline and not stop.is_set():
        injector.monitor.look()
        injector.poll()
        stop.wait(BEAT)


def _line(now: float, minutes: float, injector: Injector, plan: list[Fault]) -> str:
    monitor, found = injector.monitor, injector.found
    moment = time.monotonic()
    recovery = f", slowest recovery {max(found.recoveries):.1f} s" if found.recoveries else ""
    deaths = f", LEARNER DIED {len(found.deaths)} TIMES" if found.deaths else ""
    return (
        f"{now / 60:.1f} of {minutes:g} min, {sum(found.struck.values())} of {len(plan)} faults, "
        f"{monitor.trained:,} samples trained, {monitor.rate(moment - 10.0, moment):.0f} steps/s"
        f"{recovery}{deaths}"
    )


def _misbehaved(folder: Path) -> dict[str, int]:
    """What the rogues counted of themselves; newest lives only."""
    counts: Counter[str] = Counter()
    for path in folder.glob("*.counts.json"):
        try:
            counts.update(json.loads(path.read_text("utf-8")))
        except ValueError:
            continue  # it was killed while it wrote
    return dict(counts)


def _events(stage: Stage) -> str:
    path = stage.run_folder() / "events.log"
    return path.read_text(errors="replace", encoding="utf-8") if path.exists() else ""
