"""What every actor endpoint has in common: the book of its uploads, and what is read in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from lndrl.transport.ledger import Entry, Ledger
from lndrl.transport.messages import Ack, ChunkHeader, encode_chunk


class Bookkeeper:
    """The part of ``ActorEndpoint`` that needs no wire; how chunks travel is its heirs' own."""

    def __init__(self, window: int) -> None:
        self.ledger = Ledger(window)

    def keep_book(self, path: Path) -> None:
        """Note every upload in a file."""
        self.ledger.keep_book(path)

    def acks(self) -> list[Ack]:
        """Acks that settled chunks since the last call."""
        return self.ledger.drain_acks()

    def pending(self) -> int:
        """Chunks not yet settled."""
        return self.ledger.pending()

    def needs_hello(self) -> bool:
        """Whether another learner answered."""
        return self.ledger.needs_hello()

    def done(self) -> bool:
        """Whether training has finished."""
        return self.ledger.done()

    def silence(self) -> float:
        """Seconds since the learner was last heard."""
        return self.ledger.silence()

    def newest(self) -> tuple[int, str]:
        """Newest known weights version and learner."""
        return self.ledger.newest()

    def wait_newer(self, version: int, timeout: float) -> bool:
        """Wait for other weights than ``version``; with one thread use timeout 0."""
        return self.ledger.wait_newer(version, timeout)

    def _written(
        self, header: ChunkHeader, arrays: Mapping[str, NDArray[Any]], megabytes: int
    ) -> Entry:
        """The chunk as it goes into the book; raises when this actor may not upload, or so much.

        ``megabytes`` (MiB) is what the learner's configuration allows.
        """
        self.ledger.check_ready()
        samples = header.steps * header.worlds
        payload = encode_chunk(header, arrays, megabytes)
        return Entry(header.actor_id, header.incarnation, header.sequence, payload, samples)
