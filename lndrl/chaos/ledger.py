"""The independent ledger: what actors and learner wrote down, read again and balanced.

A chunk is (actor, life, sequence). The learner writes ``runs/NAME/ledger.jsonl``: a line for every
acceptance before it is acknowledged, for every update with its chunks, and for every chunk dropped
with the rule that did it. A ``resumed`` line takes back all updates beyond its checkpoint; a chunk
that it then drops by the rule ``restart`` may come and be accepted again. Actors write what they
produced and which answer settled it. Nothing here knows how either of them works.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lndrl.numbering import by_number

Chunk = tuple[str, str, int]
ACKNOWLEDGED = ("accepted", "duplicate")
SHOWN = 20  # contradictions that are kept as words


@dataclass
class Fate:
    """What became of the newest acceptance of a chunk; ``update`` while it counts as trained."""

    samples: int
    update: int | None = None
    rule: str | None = None


@dataclass
class LearnerBook:
    """The learner's side, line by line. Counts are samples unless they say chunks."""

    fates: dict[Chunk, Fate] = field(default_factory=dict)
    settled: Counter[str] = field(default_factory=Counter)  # of acceptances that were replaced
    acknowledged: int = 0
    duplicated: int = 0
    again: int = 0  # accepted once more after a restart had dropped them
    rolled_back: int = 0
    lines: int = 0
    torn: int = 0
    resumes: int = 0
    wrong: list[str] = field(default_factory=list)
    wrongs: int = 0

    def read(self, lines: Iterable[str]) -> LearnerBook:
        """Take in lines of the file, oldest first."""
        for line in lines:
            entry = parse(line)
            self.lines += 1
            if entry is None:
                self.torn += 1
                continue
            try:
                self._take(entry)
            except (KeyError, TypeError, ValueError) as error:
                self._complain(f"line {self.lines} cannot be understood ({error!r})")
        return self

    def trained(self) -> int:
        """Samples that some update, which still counts, learned from."""
        return sum(fate.samples for fate in self.fates.values() if fate.update is not None)

    def dropped(self) -> dict[str, int]:
        """Samples by the rule that dropped them."""
        rules = Counter(self.settled)
        for fate in self.fates.values():
            if fate.update is None and fate.rule is not None:
                rules[fate.rule] += fate.samples
        return dict(sorted(rules.items()))

    def lost(self) -> dict[Chunk, int]:
        """Acknowledged chunks that were neither trained on nor dropped by a rule."""
        return {
            chunk: fate.samples
            for chunk, fate in self.fates.items()
            if fate.update is None and fate.rule is None
        }

    def _take(self, entry: dict[str, Any]) -> None:
        kind = entry["kind"]
        if kind == "accepted":
            self._accept((entry["actor"], entry["life"], entry["sequence"]), int(entry["samples"]))
        elif kind == "trained":
            chunks = _chunks(entry)
            self._check_samples(entry, chunks)
            for chunk in chunks:
                self._train(chunk, int(entry["update"]))
        elif kind == "dropped":
            chunks = _chunks(entry)
            self._check_samples(entry, chunks)
            for chunk in chunks:
                self._drop(chunk, str(entry["rule"]))
        elif kind == "resumed":
            self.resumes += 1
            self._roll_back(int(entry["update"]))
        elif kind != "checkpoint":
            self._complain(f"line {self.lines} is of the unknown kind {kind!r}")

    def _accept(self, chunk: Chunk, samples: int) -> None:
        fate = self.fates.get(chunk)
        if fate is not None:
            if fate.rule != "restart":
                self._complain(f"{chunk} was accepted a second time")
                self.duplicated += samples if fate.update is not None else 0
            if fate.update is None and fate.rule is not None:
                self.settled[fate.rule] += fate.samples
            self.again += samples
        self.acknowledged += samples
        self.fates[chunk] = Fate(samples)

    def _train(self, chunk: Chunk, update: int) -> None:
        fate = self.fates.get(chunk)
        if fate is None:
            self._complain(f"{chunk} was trained on in update {update}, but never accepted")
        elif fate.update is not None or fate.rule is not None:
            before = fate.rule or f"update {fate.update}"
            self._complain(f"{chunk} was trained on in update {update} after {before}")
            self.duplicated += fate.samples
        else:
            fate.update = update

    def _drop(self, chunk: Chunk, rule: str) -> None:
        fate = self.fates.get(chunk)
        if fate is None:
            self._complain(f"{chunk} was dropped as {rule}, but never accepted")
        elif fate.update is not None or fate.rule is not None:
            before = fate.rule or f"update {fate.update}"
            self._complain(f"{chunk} was dropped as {rule} after {before}")
        else:
            fate.rule = rule

    def _roll_back(self, update: int) -> None:
        for fate in self.fates.values():
            if fate.update is not None and fate.update > update:
                self.rolled_back += fate.samples
                fate.update = None

    def _check_samples(self, entry: dict[str, Any], chunks: Sequence[Chunk]) -> None:
        known = sum(self.fates[chunk].samples for chunk in chunks if chunk in self.fates)
        if known != entry["samples"]:
            self._complain(
                f"line {self.lines} counts {entry['samples']} samples, its chunks hold {known}"
            )

    def _complain(self, words: str) -> None:
        self.wrongs += 1
        if len(self.wrong) < SHOWN:
            self.wrong.append(words)


@dataclass
class ActorBook:
    """The actors' side: samples of every chunk produced, and the answers that settled it."""

    produced: dict[Chunk, int] = field(default_factory=dict)
    answers: dict[Chunk, str] = field(default_factory=dict)
    torn: int = 0

    def read(self, lines: Iterable[str]) -> ActorBook:
        """Take in lines of a file."""
        for line in lines:
            entry = parse(line)
            try:
                assert entry is not None
                chunk = (entry["actor"], entry["life"], entry["sequence"])
                if entry["kind"] == "produced":
                    self.produced[chunk] = int(entry["samples"])
                else:
                    self.answers[chunk] = str(entry["status"])
            except (AssertionError, KeyError, TypeError, ValueError):
                self.torn += 1
        return self


@dataclass(frozen=True)
class Balance:
    """Both sides together, in samples. ``lost`` and ``duplicated`` must be 0.

    ``acknowledged`` = ``trained`` + ``dropped`` + what of ``lost`` the learner knows; a chunk that
    was accepted again after a restart counts each time. ``unanswered``: produced, but their actor
    ended or gave up before an answer came; nothing was promised for them.
    """

    produced: int
    acknowledged: int
    accepted_again: int
    trained: int
    dropped: int
    dropped_by_rule: dict[str, int]
    rolled_back: int
    lost: int
    duplicated: int
    refused: int
    unanswered: int
    resumes: int
    torn_lines: int
    contradictions: int
    examples: list[str]


def balance(learner: LearnerBook, actors: ActorBook) -> Balance:
    """Compare what was promised with what was done."""
    lost = learner.lost()
    examples = [f"{chunk} was accepted and forgotten" for chunk in list(lost)[:SHOWN]]
    contradictions = learner.wrongs
    for chunk, status in actors.answers.items():
        if status in ACKNOWLEDGED and chunk not in learner.fates:
            lost[chunk] = actors.produced.get(chunk, 0)
            examples.append(f"{chunk} was acknowledged, but the learner never wrote it down")
    for chunk, fate in learner.fates.items():
        if actors.produced.get(chunk) != fate.samples:
            contradictions += 1
            examples.append(
                f"{chunk}: {actors.produced.get(chunk)} samples produced, {fate.samples} accepted"
            )
    dropped = learner.dropped()
    refused = sum(
        actors.produced.get(chunk, 0)
        for chunk, status in actors.answers.items()
        if status not in ACKNOWLEDGED
    )
    return Balance(
        produced=sum(actors.produced.values()),
        acknowledged=learner.acknowledged,
        accepted_again=learner.again,
        trained=learner.trained(),
        dropped=sum(dropped.values()),
        dropped_by_rule=dropped,
        rolled_back=learner.rolled_back,
        lost=sum(lost.values()),
        duplicated=learner.duplicated,
        refused=refused,
        unanswered=sum(n for chunk, n in actors.produced.items() if chunk not in actors.answers),
        resumes=learner.resumes,
        torn_lines=learner.torn + actors.torn,
        contradictions=contradictions,
        examples=[*learner.wrong, *examples][:SHOWN],
    )


def parse(line: str) -> dict[str, Any] | None:
    """A line as an object; None when a kill or a full disk tore it.

    What a new process appended to the rest of a torn line is whole and counts.
    """
    start = line.find('{"kind"')
    while start >= 0:
        try:
            entry = json.loads(line[start:])
        except ValueError:
            start = line.find('{"kind"', start + 1)
            continue
        return entry if isinstance(entry, dict) else None
    return None


def files_of(ledger: Path) -> list[Path]:
    """A learner's ledger with the files that it went on from, ``ledger.N`` first; oldest first."""
    older = [p for p in ledger.parent.glob(f"{ledger.name}.*") if p.suffix[1:].isdecimal()]
    return [*sorted(older, key=by_number, reverse=True), ledger]


def lines_of(*paths: Path) -> Iterator[str]:
    """The lines of files, of those that exist, in the order given."""
    for path in paths:
        if path.exists():
            with path.open(errors="replace", encoding="utf-8") as file:
                yield from file


def _chunks(entry: dict[str, Any]) -> list[Chunk]:
    return [(actor, life, sequence) for actor, life, sequence in entry["chunks"]]
