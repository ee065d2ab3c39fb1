"""Which uploads of one incarnation of an actor were accepted."""

from __future__ import annotations

from collections.abc import Iterable

_WINDOW = 16  # uploads that may overtake one that is still on its way


class Sequences:
    """Sequences count from 1; uploads may overtake one another.

    Everything below ``next`` is settled; ``beyond`` holds those that came early. A hole that
    stays behind ``_WINDOW`` later uploads is given up as lost, except what is ``excused``: lost
    with a learner that died, which may still come again and is not missed if it does not.
    Memory and time depend on how many came, never on the numbers.
    """

    def __init__(self, next_sequence: int = 1, beyond: Iterable[int] = ()) -> None:
        self.next = next_sequence
        self.beyond = set(beyond)
        self.excused: set[int] = set()

    def __contains__(self, sequence: int) -> bool:
        return sequence < self.next or sequence in self.beyond

    def add(self, sequence: int) -> int:
        """Note an accepted sequence; returns how many were given up as lost by that."""
        if sequence in self:
            return 0
        self.beyond.add(sequence)
        self.excused.discard(sequence)
        lost = 0
        if len(self.beyond) > _WINDOW:
            first = min(self.beyond)
            lost = first - self.next - sum(n < first for n in self.excused)
            self.next = first
        self._close()
        return lost

    def settle(self, sequence: int) -> None:
        """Note, when resuming, one that must not be accepted again."""
        if sequence not in self:
            self.beyond.add(sequence)
            self._close()

    def excuse(self, sequence: int) -> None:
        """Note, when resuming, one that is not missed."""
        if sequence not in self:
            self.excused.add(sequence)

    def _close(self) -> None:
        while self.next in self.beyond:
            self.beyond.remove(self.next)
            self.next += 1
        if self.excused:
            self.excused = {n for n in self.excused if n >= self.next}
