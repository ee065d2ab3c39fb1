"""What ranks other than 0 note of their chunks, until rank 0 has it in ``ledger.jsonl``.

At every checkpoint rank 0 appends what the others have noted since the last one, and each of them
begins a new part: ``ledger.rank-1.jsonl``, whose first line names it. A part that its rank left
behind when the job came apart is appended when the run goes on; a line tells which parts are in,
so that none is counted twice.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from learner.intake.ledger import Ledger
from learner.run.lines import older_files

_PATTERN = "ledger.rank-*.jsonl"


@dataclass
class Part:
    """Lines of one rank, under a name that no other part has."""

    name: str
    lines: list[str] = field(default_factory=list)


class PartLedger(Ledger):
    """The ledger of a rank other than 0: a part in ``folder``, and its lines at hand."""

    def __init__(self, folder: Path, rank: int) -> None:
        self._path = folder / f"ledger.rank-{rank}.jsonl"
        with suppress(OSError):  # what the disk refuses is kept here, and told in time
            folder.mkdir(parents=True, exist_ok=True)
        self._part = Part("")
        super().__init__(self._path)
        self.begin(0)

    @property
    def part(self) -> Part:
        """What was noted since the part began."""
        return Part(self._part.name, list(self._part.lines))

    def begin(self, taken: int) -> None:
        """Begin a new part, of which the first ``taken`` lines of this one are no part any more."""
        rest = self._part.lines[taken:]
        self.close()
        with suppress(OSError):
            self._path.unlink()
        self._part = Part(secrets.token_hex(8))
        super()._add(kind="part", part=self._part.name)
        for line in rest:
            self._note(line)

    def leave(self) -> None:
        """All of it is in ``ledger.jsonl``: remove the file."""
        self.close()
        with suppress(OSError):
            self._path.unlink()

    def _add(self, **row: Any) -> None:
        self._note(json.dumps(row, separators=(",", ":")))

    def _note(self, line: str) -> None:
        self._part.lines.append(line)
        assert self._file is not None
        self._file.add(line)


def parts_in(folder: Path) -> list[Part]:
    """The parts that ranks left behind in the folder of a run; what cannot be read is passed over.

    A last line that is cut off is no line.
    """
    found = []
    for path in sorted(folder.glob(_PATTERN)):
        try:
            lines = path.read_bytes().split(b"\n")[:-1]
            head = json.loads(lines[0])
            rest = [line.decode() for line in lines[1:]]
            found.append(Part(str(head["part"]), rest))
        except (OSError, ValueError, KeyError, TypeError, IndexError, RecursionError):
            continue
    return found


def remove_parts(folder: Path) -> None:
    """Remove the parts in ``folder``, which are in ``ledger.jsonl`` now."""
    for path in folder.glob(_PATTERN):
        with suppress(OSError):
            path.unlink()


def append(ledger: Ledger, parts: Iterable[Part], known: frozenset[str] = frozenset()) -> int:
    """Append ``parts`` to ``ledger`` but for those that are ``known``; returns how many lines."""
    appended, done = 0, set(known)
    for part in parts:
        if part.name in done:
            continue
        done.add(part.name)
        ledger.copy(part.lines)
        ledger.folded(part.name)
        appended += len(part.lines)
    return appended


def appended_to(path: Path) -> frozenset[str]:
    """Names of the parts that the ledger at ``path``, and the file before it, already hold."""
    names: set[str] = set()
    for each in (*older_files(path, 1), path):
        with suppress(OSError):
            names |= set(_folded(each.read_bytes()))
    return frozenset(names)


def _folded(data: bytes) -> Iterator[str]:
    for line in data.split(b"\n"):
        if line.startswith(b'{"kind":"folded"'):
            with suppress(ValueError, KeyError, TypeError):
                yield str(json.loads(line)["part"])
