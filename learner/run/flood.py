"""Floods of events: the first few are told, the rest is counted."""

from __future__ import annotations

from dataclasses import dataclass, field

from lndrl.numbering import by_number

WINDOW = 5.0  # s
_EACH = 3  # events told per sender and window
_ALL = 60  # events told per kind and window, whoever sent them
_NAMED = 20  # senders remembered by name


@dataclass
class _Window:
    begin: float
    told: dict[str, int] = field(default_factory=dict)
    left: int = _ALL
    held: int = 0
    senders: set[str] = field(default_factory=set)


class Flood:
    """Which events to tell. Memory is bounded whatever comes; kinds are the program's own."""

    def __init__(self) -> None:
        self._windows: dict[str, _Window] = {}

    def admits(self, kind: str, sender: str, now: float) -> bool:
        """Whether an event at ``now`` (monotonic s) is told; else it is counted."""
        window = self._windows.setdefault(kind, _Window(now))
        if window.left > 0 and window.told.get(sender, 0) < _EACH:
            window.told[sender] = window.told.get(sender, 0) + 1
            window.left -= 1
            return True
        window.held += 1
        if len(window.senders) < _NAMED:
            window.senders.add(sender)
        return False

    def counts(self, now: float | None) -> list[tuple[str, str]]:
        """(kind, text) of windows that have ended by ``now`` and held something back.

        None ends all.
        """
        told = []
        for kind, window in list(self._windows.items()):
            if now is not None and now - window.begin < WINDOW:
                continue
            del self._windows[kind]
            if window.held:
                told.append((kind, _sentence(window)))
                if now is not None:
                    # Whoever is known to go on is only counted from here on.
                    self._windows[kind] = _Window(now, dict.fromkeys(window.senders, _EACH))
        return told


def _sentence(window: _Window) -> str:
    names = sorted(window.senders, key=by_number)
    others = len(names) - 1
    full = len(names) == _NAMED
    more = f" and {others}{' or more' if full else ''} others" if others else ""
    return f"{window.held:,} more, of {names[0]}{more}"
