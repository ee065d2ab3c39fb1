"""Which uploads of one incarnation of an actor were accepted."""

from __future__ import annotations

from collections.abc import Iterable

_WINDOW = 16  # uploads that may overtake one that is still on its way
_HOLES = 64  # runs of given-up sequences that are remembered


class Sequences:
    """Sequences count from 1; uploads may overtake one another.

    Everything below ``next`` is settled but for the ``holes``; ``beyond`` holds those that came
    early. What stays behind ``_WINDOW`` later uploads is given up and becomes a hole: should it
    come after all, it is new, for to call it known would lose it. ``excused`` are those lost with
    a learner that died, which may still come again and are not missed if they do not.
    Memory and time depend on how many came, never on the numbers; of the holes the newest
    ``_HOLES`` are remembered, as (first, last).
    """

    def __init__(
        self,
        next_sequence: int = 1,
        beyond: Iterable[int] = (),
        holes: Iterable[tuple[int, int]] = (),
    ) -> None:
        self.next = next_sequence
        self.beyond = set(beyond)
        self.holes = list(holes)
        self.excused: set[int] = set()

    def __contains__(self, sequence: int) -> bool:
        if sequence in self.beyond:
            return True
        return sequence < self.next and not any(a <= sequence <= b for a, b in self.holes)

    def add(self, sequence: int) -> int:
        """Note an accepted sequence; returns how many were given up as lost by that."""
        if sequence in self:
            return 0
        if sequence < self.next:
            self._fill(sequence)
            return 0
        self.beyond.add(sequence)
        self.excused.discard(sequence)
        lost = 0
        if len(self.beyond) > _WINDOW:
            first = min(self.beyond)
            lost = first - self.next - sum(n < first for n in self.excused)
            self.holes = [*self.holes, (self.next, first - 1)][-_HOLES:]
            self.next = first
        self._close()
        return lost

    def settle(self, sequence: int) -> None:
        """Note, when resuming, one that must not be accepted again."""
        if sequence in self:
            return
        if sequence < self.next:
            self._fill(sequence)
            return
        self.beyond.add(sequence)
        self._close()

    def excuse(self, sequence: int) -> None:
        """Note, when resuming, one that is not missed."""
        if sequence not in self:
            self.excused.add(sequence)

    def _fill(self, sequence: int) -> None:
        """A part of a hole has come after all."""
        parts = []
        for first, last in self.holes:
            if first <= sequence <= last:
                parts += [(first, sequence - 1), (sequence + 1, last)]
            else:
                parts.append((first, last))
        self.holes = [(first, last) for first, last in parts if first <= last]

    def _close(self) -> None:
        while self.next in self.beyond:
            self.beyond.remove(self.next)
            self.next += 1
        if self.excused:
            self.excused = {n for n in self.excused if n >= self.next}
