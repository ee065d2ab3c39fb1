"""``ledger.jsonl``: one line for everything that happens to an acknowledged chunk.

Lines are written before the acknowledgement leaves and flushed to the system, not to the disk: a
killed learner loses none, a machine without power may. Each is an object with a ``kind``:

- accepted: actor, life, sequence, samples
- trained: update, samples, chunks as [[actor, life, sequence], ...]
- dropped: rule (one of RULES), samples, chunks
- checkpoint: update, step; the checkpoint is on disk. ``totals`` are those at this line
- resumed: update; ``trained`` lines of later updates that stand before it are void, and the
  ``dropped`` line that follows names what was lost by that
- folded: part; the lines before it are those of another rank (``parts.py``)

Beyond 16 MB the file becomes ``ledger.jsonl.1`` at a checkpoint, what was called so ``.2``, and so
on: ``FILES`` in all. The newest two reach back farther than that checkpoint, and are all that a
learner reads which goes on; the others are for whoever checks it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from learner.run.lines import LineFile, backwards, older_files
from lndrl.wording import counted

RULES = ("stale", "restart", "end", "diverged")
"""Why an acknowledged chunk may end without being trained on."""
LIMIT = 16 * 2**20
"""Bytes; reading two such files takes a learner that comes back about two seconds."""
FILES = 8
LEDGER_FILE = "ledger.jsonl"

ChunkId = tuple[str, str, int]
"""Actor, its incarnation, sequence."""


@dataclass
class Tally:
    """A number of chunks and of the samples in them."""

    chunks: int = 0
    samples: int = 0

    def add(self, samples: int, chunks: int = 1) -> None:
        """Count more."""
        self.samples += samples
        self.chunks += chunks

    def __str__(self) -> str:
        return f"{counted(self.samples, 'sample')} in {counted(self.chunks, 'chunk')}"

    @classmethod
    def read(cls, data: Any) -> Tally:
        """From plain data; raises KeyError, TypeError or ValueError."""
        return cls(_count(data["chunks"]), _count(data["samples"]))

    @classmethod
    def sum(cls, *tallies: Tally) -> Tally:
        """All together."""
        return cls(sum(t.chunks for t in tallies), sum(t.samples for t in tallies))


@dataclass
class History:
    """What a ledger tells about a run up to an update; see ``Ledger.history``.

    open: samples of chunks that were accepted and then neither trained by that update nor
    dropped; ended: rules by which others were dropped;
    mentioned: which of the chunks that were asked for appear; accepted, dropped: since the run
    began; newest_update: highest that was ever trained; damaged: lines that cannot be read.
    """

    missing: bool = True
    open: dict[ChunkId, int] = field(default_factory=dict)
    ended: dict[ChunkId, str] = field(default_factory=dict)
    mentioned: set[ChunkId] = field(default_factory=set)
    accepted: Tally = field(default_factory=Tally)
    dropped: dict[str, Tally] = field(default_factory=lambda: {rule: Tally() for rule in RULES})
    newest_update: int = 0
    damaged: int = 0
    unreadable: str = ""

    def notes(self, expected: bool) -> list[str]:
        """Sentences about what is wrong with the file."""
        if self.unreadable:
            return [f"ledger.jsonl cannot be read ({self.unreadable}); going on without"]
        if self.missing:
            lack = "ledger.jsonl is missing; what came after the checkpoint is not counted"
            return [lack] if expected else []
        damaged = counted(self.damaged, "line is", "lines are")
        return [f"ledger.jsonl: {damaged} damaged"] if self.damaged else []


class Ledger:
    """Appends to the file and reads it back; ``path`` None keeps nothing. Never raises."""

    def __init__(
        self,
        path: Path | None,
        on_change: Callable[[OSError | None], None] = lambda error: None,
        limit: int = LIMIT,
    ) -> None:
        # While the disk refuses, about 10 MB of lines wait for better times.
        self._file = LineFile(path, on_change, keep=100_000, older=FILES - 1) if path else None
        self._limit = limit

    def accepted(self, chunk: ChunkId, samples: int) -> None:
        """A chunk is about to be acknowledged."""
        actor, life, sequence = chunk
        self._add(kind="accepted", actor=actor, life=life, sequence=sequence, samples=samples)

    def trained(self, update: int, chunks: Sequence[ChunkId], samples: int) -> None:
        """An update has succeeded."""
        self._add(kind="trained", update=update, samples=samples, chunks=chunks)

    def dropped(self, rule: str, chunks: Sequence[ChunkId], samples: int) -> None:
        """Chunks will not be trained on."""
        self._add(kind="dropped", rule=rule, samples=samples, chunks=chunks)

    def checkpoint(self, update: int, step: int, totals: dict[str, Any]) -> None:
        """A checkpoint is on disk; ``totals`` are those after all lines so far."""
        if self._file is not None and self._file.size() > self._limit:
            self._file.rotate()
        self._add(kind="checkpoint", update=update, step=step, totals=totals)

    def resumed(self, update: int) -> None:
        """The run goes on from a checkpoint."""
        self._add(kind="resumed", update=update)

    def copy(self, lines: Sequence[str]) -> None:
        """Append lines that another rank has noted."""
        if self._file is not None:
            for line in lines:
                self._file.add(line)

    def folded(self, part: str) -> None:
        """All of another rank's ``part`` has been copied."""
        self._add(kind="folded", part=part)

    def flush(self) -> bool:
        """Try to write what waits; whether nothing waits any more."""
        return self._file is None or self._file.flush()

    def close(self) -> None:
        """Write what waits and close."""
        if self._file is not None:
            self._file.close()

    def history(self, update: int, wanted: Container[ChunkId] = ()) -> History:
        """What the file tells, seen from a checkpoint at ``update``.

        ``wanted``: chunks of which to know whether they appear at all.
        """
        history = History()
        if self._file is None:
            return history
        path = self._file.path
        for part in (*older_files(path, 1), path):
            try:
                for row in _rows(part, history):
                    _book(history, row, update, wanted)
            except FileNotFoundError:
                continue
            except OSError as error:
                return History(unreadable=str(error.strerror or error))
            history.missing = False
        return history

    def _add(self, **row: Any) -> None:
        if self._file is not None:
            self._file.add(json.dumps(row, separators=(",", ":")))


def newest_totals(path: Path) -> tuple[dict[str, Any], int] | None:
    """The totals at the newest checkpoint that the ledger ``path`` notes, and its step.

    None where there is none yet; damaged lines are passed over. Raises OSError where the file
    cannot be read.
    """
    try:
        with path.open("rb") as file:
            for _, line in backwards(file):
                if b'"checkpoint"' in line and (found := _totals_in(line)) is not None:
                    return found
    except FileNotFoundError:
        pass
    return None


def _totals_in(line: bytes) -> tuple[dict[str, Any], int] | None:
    try:
        row = json.loads(line)
        if row["kind"] != "checkpoint":
            return None
        totals: dict[str, Any] = row["totals"]
        kinds = [totals[name] for name in ("accepted", "trained", "waiting")]
        for tally in [*kinds, *totals["dropped"].values()]:
            Tally.read(tally)
        return totals, _count(row["step"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def chunk_id(data: Any) -> ChunkId:
    """From plain data; raises TypeError or ValueError."""
    actor, life, sequence = data
    if not isinstance(actor, str) or not isinstance(life, str):
        raise TypeError("a chunk is named by two texts and a number")
    return actor, life, _count(sequence)


def _rows(path: Path, history: History) -> Iterator[dict[str, Any]]:
    """Objects of the file; counts lines that hold none, but for a last one cut short."""
    with path.open("rb") as file:
        for line in file:
            try:
                row = json.loads(line)
            except (ValueError, RecursionError):
                history.damaged += line.endswith(b"\n")
                continue
            if isinstance(row, dict):
                yield row
            else:
                history.damaged += 1


def _book(history: History, row: dict[str, Any], update: int, wanted: Container[ChunkId]) -> None:
    """One line; all of it or, where it is damaged, nothing."""
    try:
        kind = row["kind"]
        if kind == "accepted":
            chunk = chunk_id((row["actor"], row["life"], row["sequence"]))
            samples = _count(row["samples"])
            history.accepted.add(samples)
            history.open[chunk] = samples
            history.ended.pop(chunk, None)
            _mention(history, [chunk], wanted)
        elif kind == "trained":
            trained_at, chunks = _count(row["update"]), [chunk_id(c) for c in row["chunks"]]
            history.newest_update = max(history.newest_update, trained_at)
            if trained_at <= update:
                for chunk in chunks:
                    history.open.pop(chunk, None)
                _mention(history, chunks, wanted)
        elif kind == "dropped":
            chunks, samples = [chunk_id(c) for c in row["chunks"]], _count(row["samples"])
            history.dropped[row["rule"]].add(samples, len(chunks))
            for chunk in chunks:
                history.open.pop(chunk, None)
                history.ended[chunk] = row["rule"]
            _mention(history, chunks, wanted)
        elif kind == "checkpoint" and "totals" in row:
            accepted = Tally.read(row["totals"]["accepted"])
            dropped = {rule: Tally.read(row["totals"]["dropped"][rule]) for rule in RULES}
            history.accepted, history.dropped = accepted, dropped
    except (KeyError, TypeError, ValueError):
        history.damaged += 1


def _mention(history: History, chunks: list[ChunkId], wanted: Container[ChunkId]) -> None:
    history.mentioned.update(chunk for chunk in chunks if chunk in wanted)


def _count(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"{value!r} is not a count")
    return value
