"""Learner and actors on one machine: in processes of their own, or all in this one."""

from __future__ import annotations

import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from lndrl import kernels
from lndrl.cli.signals import say
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.transport import open_viewer, reachable
from lndrl.wording import counted

if TYPE_CHECKING:
    from actors.balance import Balance
    from actors.fleet import Fleet
    from learner.learner import Learner
    from learner.ppo.team import Team
    from learner.run.record import RunSummary
    from lndrl.cli.signals import Stop
    from lndrl.transport import Security, ViewerEndpoint
    from lndrl.transport.frames import Watching
    from lndrl.transport.status import Status
    from lndrl.view.dashboard.feed import News

_TICK = 0.25  # s between looks at the fleet and redraws


def train_serially(
    config: RunConfig, path: Path, resume: bool, checkpoint: str | None, stop: Stop
) -> RunSummary:
    """Train in this process and thread: same bits every time. Returns the summary.

    The same learner and actor objects as in a distributed run, over the in-memory transport.
    """
    from actors.actor import Actor
    from actors.evaluator import Evaluator
    from learner.learner import Learner
    from lndrl.transport import MemoryNetwork
    from lndrl.view.dashboard.screen import plain_line

    network = MemoryNetwork(config.transport)
    learner = Learner(config, path, network.learner(), resume, checkpoint)
    try:
        learner.begin()
        actors = [
            Actor(network.actor(), actor_id=f"serial-{i:03d}", incarnation=_life(learner, i))
            for i in range(config.fixed_actors)
        ]
        evaluator = Evaluator(network.evaluator(), evaluator_id="serial", incarnation="serial")
        # At fixed updates, so that what is validated repeats, too.
        interval = config.learner.checkpoint_interval if config.learner.validation_episodes else 0
        while not learner.finished and not stop.is_set():
            for actor in actors:
                if actor.ready():
                    with learner.split.during("wait"):
                        actor.run_chunk(stop.is_set)
                if learner.advance(timeout=0.0):
                    say(plain_line(_status(learner)), sys.stdout)
                    if interval and learner.counters.updates % interval == 0:
                        evaluator.round(stop.is_set)
        if interval and learner.finished:
            evaluator.round(stop.is_set)  # nothing where the last weights have been validated
        learner.end()
        return learner.summary()
    finally:
        learner.close()


def train_locally(
    config: RunConfig,
    path: Path,
    resume: bool,
    checkpoint: str | None,
    dashboard: bool,
    stop: Stop,
    security: Security | None = None,
    team: Team | None = None,
) -> RunSummary:
    """Train with the learner in this process and actors in others; returns the summary.

    Draws the dashboard when asked to, else prints a line per update. ``security`` is the
    learner's; the actors get theirs from it. ``team``: this process is its rank 0. Raises
    UserError when learner or actors cannot go on.
    """
    from learner.service import run_learner

    # Before anything is made: without actors there is no run.
    guards = None if security is None else (security, security.of_local("actor"))
    ready: list[Learner] = []
    outcome: list[RunSummary] = []
    failure: list[BaseException] = []

    def serve() -> None:
        try:
            summary = run_learner(
                config,
                path,
                resume,
                stop=stop,
                checkpoint=checkpoint,
                quiet=dashboard,
                on_ready=ready.append,
                security=security,
                team=team,
            )
            outcome.append(summary)
        except BaseException as error:
            failure.append(error)

    thread = threading.Thread(target=serve, name="learner")
    thread.start()
    try:
        while not ready and thread.is_alive():
            time.sleep(0.02)
        if ready:
            _supervise(config, ready[0], thread, dashboard, stop, guards)
    finally:
        stop.set()
        thread.join()
    if failure:
        raise failure[0]
    return outcome[0]


def _supervise(
    config: RunConfig,
    learner: Learner,
    thread: threading.Thread,
    dashboard: bool,
    stop: Stop,
    guards: tuple[Security, Security | None] | None,
) -> None:
    """Keep the fleet alive and the picture fresh until the learner's thread ends.

    ``guards`` protect the learner and its actors.
    """
    from actors.balance import Balance, first_choice
    from actors.fleet import Fleet
    from lndrl.machine.cores import usable_cores

    cores = usable_cores()
    choice = first_choice(config, cores, learner.ppo.device.type)
    learner.events.add(
        "balance",
        f"{choice.actors} x {counted(choice.worlds, 'world')} to begin with, "
        f"{counted(cores, 'core')}",
    )
    # Threads start with the first update, which needs actors; half for each network.
    share = learner.crew.team.neighbours if learner.crew is not None else 1
    learner.ppo.work.threads = max(1, choice.learner_threads // (2 * share))
    fleet = Fleet(
        reachable(config.transport.endpoint),
        choice.actors,
        log=lambda t: learner.events.add("fleet", t),
        security=guards[1] if guards else None,
        namespace=config.transport.namespace,
        lease=config.transport.lease,
    )
    evaluator = _Evaluator(config, learner, guards[0] if guards else None)
    adapts = config.actor.count == "auto" and config.learner.mode == "async"
    balance = Balance(most=cores) if adapts else None
    show = _Screen(learner, guards[0] if guards else None) if dashboard else _Lines(learner)
    try:
        with show:
            fleet.start()
            while thread.is_alive():
                show.update()
                code = fleet.poll() if not learner.finished else None
                if code == 2 or (code == 0 and not learner.finished):
                    raise UserError(fleet.error or "all actors ended before the run was finished")
                if stop.is_set():
                    break
                if balance is not None:
                    _keep_balance(balance, fleet, learner)
                evaluator.poll(fleet)
                show.rest(_TICK)
            stop.set()
            thread.join()
            show.update()
    finally:
        evaluator.stop()
        fleet.stop()


class _Evaluator:
    """One evaluator process where the run validates; training goes on whatever becomes of it."""

    def __init__(self, config: RunConfig, learner: Learner, security: Security | None) -> None:
        from actors.fleet import Fleet

        self._learner = learner
        self._fleet: Fleet | None = None
        self._begun = False
        if not config.learner.validation_episodes:
            return
        try:
            own = security.of_local("evaluator") if security is not None else None
        except UserError as error:
            learner.events.add("fleet", f"nothing is validated: {error}")
            return
        self._fleet = Fleet(
            reachable(config.transport.endpoint),
            1,
            log=self._log,
            security=own,
            namespace=config.transport.namespace,
            lease=config.transport.lease,
            role="evaluator",
        )

    def poll(self, actors: Fleet) -> None:
        """Look after it; it starts once all actors have, which compile what it needs, too."""
        if self._fleet is None:
            return
        if not self._begun and actors.settled():
            self._fleet.start()
            self._begun = True
        if self._begun and self._fleet.poll() == 2:
            self._learner.events.add("fleet", f"nothing is validated: {self._fleet.error}")
            self.stop()

    def stop(self) -> None:
        """End it; can be called twice."""
        if self._fleet is not None:
            self._fleet.stop()
            self._fleet = None

    def _log(self, text: str) -> None:
        if " validated" not in text:  # the learner says so itself, and more of it
            self._learner.events.add("fleet", text)


def _keep_balance(balance: Balance, fleet: Fleet, learner: Learner) -> None:
    """One actor more or less where the shares of waiting say so; each change is an event."""
    waits = learner.split.shares(balance.WINDOW)["wait"]
    idle = learner.whole.actor_shares(balance.WINDOW).get("wait", 0.0)
    settled = bool(learner.figures) and fleet.settled()
    advice = balance.advise(time.monotonic(), len(fleet), waits, idle, settled)
    if not advice:
        return
    if advice > 0:
        fleet.grow()
    elif (taken := fleet.shrink()) is not None:
        learner.roster.retire(taken)
    learner.events.add(
        "balance",
        f"{'one actor more' if advice > 0 else 'one actor less'}, {len(fleet)} now: the learner "
        f"waited {waits:.0%} of the last {balance.WINDOW:.0f} s, the actors {idle:.0%}",
    )


class _Lines:
    """A line on stdout per update and per change of verdict, and else every half minute.

    Every few seconds while kernels are compiled.
    """

    def __init__(self, learner: Learner) -> None:
        self._learner = learner
        self._shown = (-1, "")
        self._printed = 0.0

    def __enter__(self) -> _Lines:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            sys.stdout.flush()

    def rest(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)

    def update(self) -> None:
        """Print if there is news."""
        from lndrl.view.dashboard.screen import plain_line

        status = _status(self._learner)
        word = status.verdict.partition(":")[0]
        shown, self._shown = self._shown, (status.updates, word)
        patience = kernels.LINE_EVERY if word == "compiling" else 30.0
        if shown != self._shown or time.monotonic() - self._printed > patience:
            self._printed = time.monotonic()
            say(plain_line(status), sys.stdout)


class _Screen:
    """The dashboard, drawn in this terminal, with its keys but for q: Ctrl-C ends a training."""

    def __init__(self, learner: Learner, security: Security | None) -> None:
        from rich.console import Console

        self._learner, self._security = learner, security
        self._viewer: ViewerEndpoint | None = None
        self._news: News | None = None
        self._console = Console(highlight=False)
        self._stack = ExitStack()

    def __enter__(self) -> _Screen:
        from lndrl.view.dashboard.board import Board
        from lndrl.view.dashboard.keys import key_presses

        keys = self._stack.enter_context(key_presses())
        board = Board(
            self._console,
            keys,
            leaving="Ctrl-C stops, --resume goes on",
            leaves=False,
            requests=[self._request],
            watches=[self._watch],
        )
        self._board = self._stack.enter_context(board)
        return self

    def __exit__(self, *details: object) -> None:
        self._stack.close()
        if self._viewer is not None:
            self._viewer.close()

    def _watch(self, actor_id: str) -> Watching:
        """Over a connection of its own, as any dashboard has one: actors are other processes."""
        if self._viewer is None:
            config = self._learner.config.transport
            security = self._security and self._security.of_local("dashboard")
            self._viewer = open_viewer(reachable(config.endpoint), config, security)
        return self._viewer.watch(actor_id)

    def _request(self, action: str) -> str:
        from lndrl.transport.operation import Granted, Request

        request = Request(action, self._learner.folder.run_id, "this terminal")
        answer = self._learner.orders.on_request(request)
        return answer.sentence if isinstance(answer, Granted) else f"refused: {answer.reason}"

    def rest(self, seconds: float) -> None:
        """Wait, but for keys and for what a live world shows."""
        if self._news is None:
            time.sleep(seconds)
            return
        with suppress(OSError):  # of a terminal that is gone
            self._board.turn([self._news], seconds)

    def update(self) -> None:
        """Heed the keys, and redraw what is new."""
        from learner.status import snapshot
        from lndrl.view.dashboard.feed import news_of

        reply = {"snapshot": snapshot(self._learner), "history": list(self._learner.history)}
        self._news = news_of(reply)
        self.rest(0.0)


def _status(learner: Learner) -> Status:
    from learner.status import snapshot
    from lndrl.transport.status import parse_status

    return parse_status(snapshot(learner))


def _life(learner: Learner, index: int) -> str:
    """Incarnations of serial actors: the same in the same run, new after a resume."""
    return f"serial-{learner.counters.updates}-{index}"
