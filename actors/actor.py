"""One simulator actor: joins a learner, collects chunks, uploads them, keeps its weights fresh.

The same object runs in a process of its own (``run``) and in the learner's thread over the
in-memory transport (``ready`` and ``run_chunk``, which never wait for the learner).
"""

from __future__ import annotations

import hashlib
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from actors.fetcher import FETCH_TIMEOUT, Fetcher
from actors.laps import Laps
from actors.rollout import Chunk, Rollout
from actors.showing import Showing
from lndrl import kernels
from lndrl.config import FIXED_ACTORS, RunConfig, parse_config
from lndrl.machine.load import Load
from lndrl.machine.memory import return_what_is_free
from lndrl.machine.threads import set_threads
from lndrl.transport import (
    NO_WEIGHTS,
    ActorEndpoint,
    ChunkHeader,
    Hello,
    LearnerUnreachableError,
    WeightsGoneError,
    Welcome,
)
from lndrl.version import VERSION
from lndrl.wording import counted

HELLO_TIMEOUT = 10.0
PATIENT_TIMEOUT = 1.0  # s per attempt, between which a stop is noticed
WEIGHTS_WAIT = 0.2  # s of one wait, between which a stop is noticed
WINDOW_WAIT = 0.02
TELL_EVERY = 1.0  # s between two words on how far kernels are

EPISODE_OFFSETS = 1 << 31
"""Hashed first episodes stay below this, so that counting on from them stays in 32 bits."""


class Actor:
    """Collects chunks for the learner behind ``endpoint``.

    ``actor_id`` names the place of this actor across restarts, ``incarnation`` this life of it;
    by default both are made up. A repeatable run passes both. ``worlds`` overrides
    ``config.actor.worlds``; where that is auto, ``siblings`` is how many actors there are (see
    ``RunConfig.worlds_per_actor``). ``patient`` waits for a learner that does not answer instead of
    failing; ``alone`` in its process, it fetches weights in a thread while worlds go on with those
    at hand, and matrix products have ``config.actor.threads`` threads.
    ``on_event(event, text)`` hears of joined, refused, stale and the like.
    """

    def __init__(
        self,
        endpoint: ActorEndpoint,
        *,
        actor_id: str = "",
        incarnation: str = "",
        worlds: int | None = None,
        siblings: int = FIXED_ACTORS,
        device: str = "cpu",
        patient: bool = False,
        alone: bool = False,
        on_event: Callable[[str, str], None] = lambda event, text: None,
    ) -> None:
        self.endpoint = endpoint
        self.actor_id = actor_id or f"actor-{secrets.token_hex(4)}"
        self.incarnation = incarnation or secrets.token_hex(8)
        self.rollout: Rollout | None = None
        self.chunks = 0  # collected in this incarnation
        self.laps = Laps()
        self._machine = Load()
        self._fetcher = Fetcher(endpoint) if alone else None
        self._alone = alone
        self._worlds, self._siblings, self._device = worlds, siblings, device
        self._patient = patient
        self._on_event = on_event
        self._welcome: Welcome | None = None
        self._first_number = 0  # action noise of chunk c is number first + c
        self._base_version = 0  # lock-step: weights version that chunk round 0 acts on
        self._round = 0  # lock-step: chunks that the learner has taken on since the base
        self._weights_from = ""  # incarnation of the learner that gave the held weights

    @property
    def done(self) -> bool:
        """True once the learner has said that training has finished."""
        return self.endpoint.done()

    @property
    def config(self) -> RunConfig:
        """The run's configuration, as the learner gave it; needs a welcome."""
        assert self.rollout is not None
        return self.rollout.config

    def run(self, stop: threading.Event) -> None:
        """Join and collect until the learner is done or ``stop`` is set.

        Raises UserError when the learner cannot be reached (unless patient), refuses this
        actor, or hands out what this program cannot use.
        """
        while not (stop.is_set() or self.done):
            if not self.run_chunk(stop.is_set):
                self._wait(stop)

    def ready(self) -> bool:
        """True when ``run_chunk`` can do its work now, without waiting for the learner."""
        if self.done:
            return False
        if self.rollout is None or self.endpoint.needs_hello():
            return True
        version, _ = self.endpoint.newest()
        enough = version != NO_WEIGHTS and version >= self._required_version()
        return enough and self._window_open()

    def run_chunk(self, stopped: Callable[[], bool] = bool) -> bool:
        """Collect and upload one chunk; False when not ``ready``, done or ``stopped()``.

        Never waits for the learner's progress. Says hello first where that is due.
        """
        self.laps.lap("wait")  # between two calls there was nothing to do
        if self.rollout is None or self.endpoint.needs_hello():
            self.join(stopped)
        self._take_acks()
        if self.rollout is None or not self.ready() or not self._take_weights(self.rollout):
            return False
        chunk = self.rollout.collect(self._first_number + self.chunks, stopped)
        if chunk is None:
            return False
        self._upload(self.rollout, chunk)
        self._take_acks()
        return True

    def join(self, stopped: Callable[[], bool] = bool) -> None:
        """Say hello and make ready for the run that the learner describes.

        Worlds that fit the learner's configuration go on where they are. Raises UserError.
        """
        rejoin = self._welcome is not None
        self._take_acks()
        kept = self.endpoint.pending()  # the hello itself may already settle them
        welcome = self._hello(stopped)
        self.laps.lap("wait")
        if welcome is None:
            return
        config = parse_config(welcome.config, "configuration from the learner")
        lockstep = config.learner.mode == "lockstep"
        self._welcome = welcome
        self.endpoint.adopt(config.transport)
        self._rebase(welcome.weights_version, kept)
        rollout = self.rollout
        if (
            rollout is None
            or rollout.config != config
            or rollout.actor_index != welcome.actor_index
        ):
            # Never play an episode twice: an actor that replaces another one, or meets a resumed
            # run, starts beyond what can have been played. In lock-step that must repeat.
            offset = self._base_version if lockstep else _hash(self.incarnation)
            self._first_number = offset
            first_episode = offset * config.actor.horizon if lockstep else offset
            index = welcome.actor_index
            worlds = self._worlds or config.worlds_per_actor(self._siblings)
            with self._compiling_told():
                rollout = Rollout(config, index, worlds, first_episode, self._device, self.laps)
            if self._alone:
                set_threads(config.actor.threads)
                return_what_is_free()  # compiling and trying took tens of megabytes
            rollout.show_on(Showing(self.endpoint, welcome.run_id, self.actor_id))
            self.rollout, self._weights_from = rollout, ""
            self.laps.restart()  # building worlds and compiling is no part of any chunk
        self._on_event(
            "joined again" if rejoin else "joined",
            f"run {welcome.run_id}, {counted(rollout.worlds, 'world')}, "
            f"weights version {welcome.weights_version}",
        )

    def _hello(self, stopped: Callable[[], bool]) -> Welcome | None:
        """The learner's welcome; None when ``stopped()`` before a learner answered."""
        hello = self._introduction()
        # A learner that was there once comes back: it is waited for.
        patient = self._patient or self._welcome is not None
        while not stopped():
            began = time.monotonic()
            try:
                return self.endpoint.hello(hello, PATIENT_TIMEOUT if patient else HELLO_TIMEOUT)
            except LearnerUnreachableError:
                if not patient:
                    raise
                # An unknown host is found out at once; it need not be asked for without pause.
                time.sleep(max(0.0, PATIENT_TIMEOUT - (time.monotonic() - began)))
        return None

    def _introduction(self, kernels_ready: int = 0, kernels_needed: int = 0) -> Hello:
        return Hello(
            actor_id=self.actor_id,
            incarnation=self.incarnation,
            host=socket.gethostname(),
            pid=os.getpid(),
            # Before the first welcome the number may be known to the learner alone.
            worlds=self.rollout.worlds if self.rollout else self._worlds or 1,
            program_version=VERSION,
            kernels_ready=kernels_ready,
            kernels_needed=kernels_needed,
        )

    @contextmanager
    def _compiling_told(self) -> Iterator[None]:
        """Tell learner and fleet how far the kernels are, should any have to be compiled now."""
        if not self._alone:  # whoever shares the process tells his own user
            yield
            return
        lines = kernels.Lines(lambda text: self._on_event("starting", text))
        told_at = float("-inf")

        def report(ready: int, needed: int) -> None:
            nonlocal told_at
            lines(ready, needed)
            if time.monotonic() - told_at >= TELL_EVERY:
                told_at = time.monotonic()
                self.endpoint.tell(self._introduction(ready, needed))

        with kernels.told(report):
            yield
        if told_at > float("-inf"):
            self.endpoint.tell(self._introduction())

    def _rebase(self, version: int, kept: int) -> None:
        """Lock-step: count chunks anew from weights ``version``.

        Of ``kept`` chunks that are still to be settled one will be the learner's first.
        """
        self._base_version = max(version, 0)
        self._round = min(kept, 1)

    def _required_version(self) -> int:
        """Lowest weights version that the next chunk may act on; in lock-step the only one.

        Lock-step acts one update behind: chunk n on version n - 1, so that the learner can
        learn from chunk n - 1 meanwhile.
        """
        if self.config.learner.mode == "async":
            return 0
        return max(self._base_version, self._base_version + self._round - 1)

    def _take_weights(self, rollout: Rollout) -> bool:
        """Fetch the weights that the next chunk must act on, where they are not held already.

        False: not to be had now. Async actors go on with the weights they hold when the newest
        cannot be had in time.
        """
        newest, learner = self.endpoint.newest()
        lockstep = rollout.config.learner.mode == "lockstep"
        wanted = self._required_version() if lockstep else newest
        if rollout.version == wanted and self._weights_from == learner:
            return True
        if self._fetcher is not None and not lockstep and self._weights_from == learner:
            self._take_fetched(rollout, learner)
            return True
        self.laps.lap("other")
        try:
            version, blob = self.endpoint.fetch(wanted if lockstep else None, FETCH_TIMEOUT)
        except WeightsGoneError:
            # The learner went on without this actor: join in again from where it is.
            self._rebase(newest, self.endpoint.pending())
            return False
        except TimeoutError:
            return not lockstep and self._weights_from == learner
        else:
            self._load(rollout, version, blob)
        finally:
            self.laps.lap("fetch")
        self._weights_from = learner
        return True

    def _load(self, rollout: Rollout, version: int, blob: bytes) -> None:
        rollout.load(version, blob)
        if self._alone:  # where the blob's pieces lay as they came, for which there are threads
            return_what_is_free()

    def _take_fetched(self, rollout: Rollout, learner: str) -> None:
        """Load newer weights of the same learner if they are here, else see that they come."""
        assert self._fetcher is not None
        self.laps.lap("other")
        fetched = self._fetcher.take(learner)
        if fetched is None:
            self._fetcher.begin(learner)
        else:
            self._load(rollout, *fetched)
        self.laps.lap("fetch")

    def _fetch_ahead(self) -> None:
        """Use a wait to get weights that have been announced meanwhile."""
        newest, learner = self.endpoint.newest()
        held = self.rollout.version if self.rollout else NO_WEIGHTS
        if self._fetcher is not None and self._weights_from == learner and newest > held:
            self._fetcher.begin(learner)

    def _window_open(self) -> bool:
        """Whether an upload would not block. Collecting later then means fresher weights."""
        window = self.config.transport.upload_window
        if self.endpoint.pending() < window:
            return True
        self.endpoint.flush(0.0)  # in one thread, this is what sends a paused chunk again
        return self.endpoint.pending() < window

    def _wait(self, stop: threading.Event) -> None:
        """A moment, for the upload window or for weights."""
        newest, _ = self.endpoint.newest()
        if self.ready():
            return
        if self.rollout is not None and not self._window_open():
            self._fetch_ahead()
            stop.wait(WINDOW_WAIT)
        else:
            self.endpoint.wait_newer(newest, WEIGHTS_WAIT)

    def _upload(self, rollout: Rollout, chunk: Chunk) -> None:
        assert self._welcome is not None
        self.chunks += 1
        self._round += 1
        header = ChunkHeader(
            run_id=self._welcome.run_id,
            actor_id=self.actor_id,
            incarnation=self.incarnation,
            sequence=self.chunks,
            steps=rollout.steps,
            worlds=rollout.worlds,
            episodes=[episode.to_dict() for episode in chunk.episodes],
            timing=self.laps.take(),
            host=socket.gethostname(),
            pid=os.getpid(),
            machine=self._machine.now(),
        )
        self.endpoint.upload(header, chunk.trajectory.to_arrays())
        self.laps.lap("upload")  # known only now, so it is told with the next chunk

    def _take_acks(self) -> None:
        """Learn what became of the uploads; weights that an ack tells of are fetched next."""
        for ack in self.endpoint.acks():
            if ack.status in ("stale", "refused"):
                # The learner still waits for a chunk of this round.
                self._round = max(0, self._round - 1)
                self._on_event(ack.status, ack.reason)


def _hash(text: str) -> int:
    """A number that differs for different texts, the same on every machine."""
    digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") % EPISODE_OFFSETS
