"""One row of a fleet bench: a learner, so many synthetic actors, and what both say."""

from __future__ import annotations

import json
import math
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from itertools import pairwise
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

from lndrl.bench.fleet import door, model, play, serve
from lndrl.bench.fleet.plan import LinkPlan, Plan
from lndrl.bench.fleet.scene import fleet_config
from lndrl.bench.scene import settings as asked_for
from lndrl.chaos.hosts import Hosts
from lndrl.chaos.ledger import ActorBook, LearnerBook, balance, files_of, lines_of
from lndrl.chaos.monitor import cpu_seconds
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.memory import resident_megabytes
from lndrl.transport import ViewerEndpoint, free_endpoint, open_viewer

Row = dict[str, Any]

COLLECTOR = Path(__file__).with_name("chunk.py")
_LEARNER = "192.0.2.1"  # its address at a long wire
PROCESSES = 4
"""That play the actors, at most."""
_JOIN = 300.0  # s for the learner to be there and all actors to have joined
_WARM = 2.0  # s of sending before the timed span; at least a period
_LOOK = 0.5  # s between two looks at the learner
_WEIGHTS = 180.0  # s within which all must have new weights
_END = 120.0


def measure(plan: Plan, show: Callable[[str], None] = lambda line: None) -> Iterator[Row]:
    """A row for every number of actors in ``plan``; ``show`` hears what goes on.

    ``steps_per_second``: acknowledged; ``ack_p50_ms``, ``ack_p99_ms``: from sending a chunk first
    to its acknowledgement; ``weights_seconds``: from publishing a version until every actor has
    it or a newer one, None where some had not within 180 s; ``lost``: samples that were
    acknowledged and are not in the learner's ledger as trained, dropped by a rule or waiting at
    the end; ``learner_rss_mb``, ``learner_cores``: memory and CPU time per s of the learner's
    process; ``status_p99_ms``: of the answer to a dashboard; ``predicted_steps_per_second``: by the
    model, None where ``plan`` wants none. Raises UserError when a process does not get going.
    """
    cost = None
    if plan.model:
        show("a full door, for the model")
        full = replace(plan, every=model.EVERY, model=False)
        horizon = fleet_config(asked_for()).actor.horizon
        cost = model.calibrated(lambda worlds: _row(full, model.SENDERS, show, worlds), horizon)
    for actors in plan.actors:
        row = _row(plan, actors, show)
        samples = row["worlds"] * row["horizon"]
        offered = row["offered_steps_per_second"]
        told = None if cost is None else cost.steps_per_second(offered, samples)
        yield row | {"predicted_steps_per_second": told}


def _row(plan: Plan, actors: int, show: Callable[[str], None], worlds: int | None = None) -> Row:
    """A row of so many ``actors``; ``worlds`` of each: None for as many as they would have."""
    more = [] if worlds is None else [f"actor.worlds={worlds}"]
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as place:
        return _measured(plan, actors, fleet_config([*asked_for(), *more]), Path(place), show)


def _measured(
    plan: Plan, actors: int, config: RunConfig, folder: Path, show: Callable[[str], None]
) -> Row:
    endpoint = f"tcp/{_LEARNER}:7447" if plan.link else free_endpoint()
    transport = config.transport.model_copy(update={"endpoint": endpoint})
    config = config.model_copy(update={"transport": transport})
    worlds = config.worlds_per_actor(actors)
    samples = worlds * config.actor.horizon
    chunk = _collect(folder, worlds)
    period = plan.period(samples)
    with ExitStack() as stack:
        there, here = stack.enter_context(_far_apart(plan.link))
        drain = plan.update == "drain"
        learner = stack.enter_context(_learner(config, folder / "run", drain, there))
        learner.wait_for("ready", _JOIN)
        to = endpoint
        if plan.site:
            to = "tcp/127.0.0.1:7448" if plan.link else free_endpoint()
            stack.enter_context(_site(config, to, here)).wait_for("ready", _JOIN)
        show(f"{actors} actors join")
        crowd = [
            stack.enter_context(_part(config, to, chunk, folder, first, count, period, here))
            for first, count in shares_of(actors, PROCESSES)
        ]
        for part in crowd:
            part.wait_for("joined", _JOIN)
        _tell_all(crowd, "begin")
        if plan.update == "real":
            _tell_all(crowd, "fetch", 0)
        row: Row = {"actors": actors, "update": plan.update, "worlds": worlds}
        row["horizon"] = config.actor.horizon
        row["chunk_kb"] = len(chunk.read_bytes()) / 1e3
        row["offered_steps_per_second"] = actors * samples / period
        show(f"{actors} actors send")
        row |= _timed(plan, samples, learner, crowd, "" if plan.link else endpoint)
        show(f"{actors} actors fetch weights")
        row["weights_seconds"] = _fan_out(learner, crowd)
        _tell_all(crowd, "stop")
        settled = [part.wait_for("stopped", play.FINISH + 30.0)[0] for part in crowd]
        learner.tell("stop")
        learner.wait_for("ended", _END)
    books = sorted(folder.glob("*.book"))
    ledger = LearnerBook().read(lines_of(*files_of(folder / "run/ledger.jsonl")))
    both = balance(ledger, ActorBook().read(lines_of(*books)))
    row["lost"] = both.lost
    row["unanswered"] = both.unanswered if not all(settled) else 0
    return row | {"dropped": both.dropped_by_rule, "duplicated": both.duplicated}


def _timed(plan: Plan, samples: int, learner: Child, crowd: Sequence[Child], endpoint: str) -> Row:
    """What the timed span shows."""
    time.sleep(max(_WARM, min(plan.period(samples), plan.span(samples))))
    began, spent = time.monotonic(), cpu_seconds(learner.pid) or 0.0
    seconds = plan.span(samples)
    _tell_all(crowd, "count", began, began + seconds)
    memory, lag, answers = 0.0, None, []
    viewer = open_viewer(endpoint) if endpoint else None
    try:
        while (now := time.monotonic()) < began + seconds:
            if viewer is not None:
                answers.append(_status_ms(viewer))
            memory = max(memory, resident_megabytes(learner.pid))
            learner.check()
            time.sleep(max(0.0, now + _LOOK - time.monotonic()))
        lag = _lag(viewer) if viewer is not None else None
    finally:
        if viewer is not None:
            viewer.close()
    _tell_all(crowd, "tell")
    counted = [part.wait_for("counted", 60.0) for part in crowd]
    cores = ((cpu_seconds(learner.pid) or 0.0) - spent) / (time.monotonic() - began)
    latencies = sorted(1e3 * each for part in counted for each in part[1])
    return {
        "steps_per_second": sum(part[0] for part in counted) / seconds,
        "chunks_per_second": len(latencies) / seconds,
        "ack_p50_ms": quantile(latencies, 0.5),
        "ack_p99_ms": quantile(latencies, 0.99),
        "status_p50_ms": quantile(sorted(answers), 0.5),
        "status_p99_ms": quantile(sorted(answers), 0.99),
        "lag_mean": lag,
        "learner_rss_mb": memory,
        "learner_cores": cores,
    }


def _fan_out(learner: Child, crowd: Sequence[Child]) -> float | None:
    """s from the next version's publication until all have it; None where some never had."""
    published = dict(learner.drain("published"))
    learner.tell("publish")
    version, moment = learner.wait_for("published", _WEIGHTS)
    while version in published:
        version, moment = learner.wait_for("published", _WEIGHTS)
    _tell_all(crowd, "fetch", version)
    try:
        held = [part.wait_for("hold", _WEIGHTS, lambda told: told[0] == version) for part in crowd]
    except SilentError:
        return None
    return max(0.0, max(found[1] for found in held) - moment)


def shares_of(actors: int, processes: int) -> list[tuple[int, int]]:
    """(first, count) of at most ``processes`` parts of so many actors, as equal as can be."""
    parts = min(actors, processes)
    bounds = [actors * part // parts for part in range(parts + 1)]
    return [(a, b - a) for a, b in pairwise(bounds)]


def quantile(ordered: Sequence[float], share: float) -> float | None:
    """The smallest of ``ordered`` values that ``share`` of them do not exceed; None of nothing."""
    if not ordered:
        return None
    return ordered[min(len(ordered) - 1, math.ceil(share * len(ordered)) - 1)]


def _status_ms(viewer: ViewerEndpoint) -> float:
    began = time.monotonic()
    viewer.status(30.0)
    return 1e3 * (time.monotonic() - began)


def _lag(viewer: ViewerEndpoint) -> float:
    return float(viewer.status(30.0)["snapshot"].get("lag", {}).get("mean") or 0.0)


class SilentError(UserError):
    """A process of a row has not said in time what was waited for."""


class Child:
    """A process of a row and the pipe to it."""

    def __init__(self, name: str, process: SpawnProcess, channel: Connection) -> None:
        self._name, self._process, self._channel = name, process, channel
        self._told: list[list[Any]] = []
        assert process.pid is not None
        self.pid = process.pid

    def tell(self, word: str, *what: Any) -> None:
        """Send a command."""
        command: Any = [word, *what] if self._name != "learner" else word
        with suppress(OSError):
            self._channel.send_bytes(json.dumps(command).encode())

    def drain(self, kind: str) -> list[list[Any]]:
        """All of that kind that it has told and nobody has waited for."""
        while self._channel.poll():
            self._told.append(json.loads(self._channel.recv_bytes()))
        found = [each[1:] for each in self._told if each[0] == kind]
        self._told = [each for each in self._told if each[0] != kind]
        return found

    def wait_for(
        self, kind: str, seconds: float, wanted: Callable[[list[Any]], bool] = lambda told: True
    ) -> list[Any]:
        """What it tells with the next word of that kind; raises SilentError, UserError."""
        deadline = time.monotonic() + seconds
        while True:
            for place, (word, *what) in enumerate(self._told):
                if word == kind and wanted(what):
                    del self._told[place]
                    return what
            left = deadline - time.monotonic()
            if left <= 0:
                raise SilentError(
                    f"bench fleet: the {self._name} did not say {kind} within {seconds:g} s; try"
                    " fewer actors, or a machine with less else to do"
                )
            wait([self._channel, self._process.sentinel], left)
            self.check()
            if self._channel.poll():
                self._told.append(json.loads(self._channel.recv_bytes()))

    def check(self) -> None:
        """Raise UserError when it has ended or failed."""
        failed = next((each for each in self._told if each[0] == "failed"), None)
        if failed is not None:
            raise UserError(f"bench fleet: {failed[1]}")
        if not self._process.is_alive() and not self._channel.poll():
            raise UserError(f"bench fleet: the {self._name} ended early")

    def end(self) -> None:
        """End it now, if it has not ended."""
        self._process.join(5.0)
        self._process.kill()
        self._process.join()
        self._channel.close()


@contextmanager
def _process(name: str, target: Callable[..., None], *arguments: Any) -> Iterator[Child]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=target, args=(*arguments, theirs), name=name, daemon=True)
    process.start()
    theirs.close()
    child = Child(name, process, ours)
    try:
        yield child
    finally:
        child.end()


def _learner(config: RunConfig, folder: Path, drain: bool, namespace: str) -> Any:
    plain = config.model_dump(mode="json")
    return _process("learner", serve.main, plain, str(folder), drain, namespace)


@contextmanager
def _far_apart(link: LinkPlan | None) -> Iterator[tuple[str, str]]:
    """The namespaces of learner and actors, a wire between them; empty ones without ``link``."""
    if link is None:
        yield "", ""
        return
    with Hosts() as hosts:
        for name in ("learner", "actors"):
            hosts.add(name)
        ends = ("learner", f"{_LEARNER}/24", "actors", "192.0.2.2/24")
        wire = hosts.wire(*ends, delay=0.5 * link.round_trip, loss=link.loss, seed=1)
        hosts.congestion(wire, link.congestion)
        yield hosts.namespace("learner"), hosts.namespace("actors")


def _site(config: RunConfig, listen: str, namespace: str) -> Any:
    return _process("site", door.main, config.model_dump(mode="json"), listen, namespace)


def _part(
    config: RunConfig,
    endpoint: str,
    chunk: Path,
    folder: Path,
    first: int,
    count: int,
    period: float,
    namespace: str,
) -> Any:
    plain = config.model_dump(mode="json")
    book = str(folder / f"{first:04d}.book")
    part = play.Part(endpoint, plain, str(chunk), book, first, count, period, namespace)
    return _process(f"process of actors from {first}", play.main, part)


def _tell_all(crowd: Sequence[Child], word: str, *what: Any) -> None:
    for part in crowd:
        part.tell(word, *what)


def _collect(folder: Path, worlds: int) -> Path:
    """A chunk of ``worlds`` worlds, collected by a process of its own."""
    file = folder / "chunk.npz"
    done = subprocess.run(
        [sys.executable, str(COLLECTOR), str(file), str(worlds), *asked_for()],
        env=this_program() | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        encoding="utf-8",
        errors="replace",
    )
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no word"])[-1]
        raise UserError(f"bench fleet: no chunk could be collected ({last})")
    return file
