"""Parts of a measurement, one after the other within a budget of time; none harms another."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from lndrl.errors import UserError

WAITING, MEASURING, DONE = "not begun", "measuring", "done"
SHORT, FAILED, SKIPPED = "out of time", "failed", "skipped"


class Tell(Protocol):
    """Hears of a figure as soon as it is there."""

    def __call__(self, value: Any, *keys: str) -> None:
        """``value`` of what JSON knows, at ``keys`` of a part's figures, one within the other."""


class OutOfTimeError(Exception):
    """The time of a part is up; what it has told stays."""


@dataclass(frozen=True)
class Part:
    """One part: ``measure(tell, deadline)``, ``deadline`` in s of ``time.monotonic``.

    ``share``: s of a whole that all parts' shares make up; what is left of it goes to those who
    come later. ``least``: s without which it does not begin. ``borrows``: it may take of later
    parts all but their least, since they are worth nothing without it.
    """

    name: str
    share: float
    least: float
    measure: Callable[[Tell, float], None]
    borrows: bool = False


@dataclass
class Outcome:
    """What became of a part: ``state``, the s that it took, ``why`` where it is not done."""

    state: str = WAITING
    seconds: float = 0.0
    share: float = 0.0
    why: str = ""
    figures: dict[str, Any] = field(default_factory=dict)

    def add(self, value: Any, *keys: str) -> None:
        """Put a figure in its place."""
        place = self.figures
        for key in keys[:-1]:
            place = place.setdefault(key, {})
        place[keys[-1]] = value


Outcomes = Mapping[str, Outcome]


def measure_parts(
    parts: Sequence[Part],
    seconds: float,
    keep: Callable[[Outcomes], None],
    say: Callable[[str], object],
    clock: Callable[[], float] = time.monotonic,
) -> dict[str, Outcome]:
    """Measure ``parts`` in ``seconds``; what became of each by its name.

    A part that has less than its ``least`` left is skipped, one that raises has failed, and the
    next one begins. ``keep`` hears of all outcomes before the first part, after every figure, and
    after every part; ``say`` hears a line of each. KeyboardInterrupt passes through.
    """
    scale = seconds / sum(part.share for part in parts)
    outcomes = {part.name: Outcome(share=scale * part.share) for part in parts}
    keep(outcomes)
    end = clock() + seconds
    for number, part in enumerate(parts):
        outcome = outcomes[part.name]
        left = _allowed(parts[number:], outcome.share / part.share, end - clock())
        if left < part.least:
            outcome.state = SKIPPED
            outcome.why = f"{left:.0f} s were left for it, {part.least:.0f} are the least it takes"
        else:
            say(f"{part.name}, at most {left:.0f} s")
            _measure(part, outcome, clock() + left, lambda: keep(outcomes), clock)
        keep(outcomes)
        say(line(part.name, outcome))
    return outcomes


def line(name: str, outcome: Outcome) -> str:
    """What became of a part, in one line."""
    took = f" after {outcome.seconds:.0f} s" if outcome.state != SKIPPED else ""
    why = f": {outcome.why}" if outcome.why else ""
    return f"{name}: {outcome.state}{took}{why}"


def _allowed(parts: Sequence[Part], scale: float, left: float) -> float:
    """s for the first of ``parts``: its share, and what was ``left`` over by those before it."""
    surplus = left - scale * sum(part.share for part in parts)
    mine = scale * parts[0].share + max(0.0, surplus)
    if parts[0].borrows:
        mine = max(mine, left - sum(part.least for part in parts[1:]))
    return max(0.0, min(mine, left))


def _measure(
    part: Part, outcome: Outcome, due: float, keep: Callable[[], None], clock: Callable[[], float]
) -> None:
    began = clock()
    outcome.state = MEASURING

    def tell(value: Any, *keys: str) -> None:
        outcome.add(value, *keys)
        outcome.seconds = clock() - began
        keep()

    try:
        part.measure(tell, due)
        outcome.state = DONE
    except OutOfTimeError as error:
        outcome.state, outcome.why = SHORT, str(error)
    except KeyboardInterrupt:
        outcome.why = "interrupted"
        keep()
        raise
    except Exception as error:
        outcome.state, outcome.why = FAILED, sentence(error)
    finally:
        outcome.seconds = clock() - began


def sentence(error: BaseException) -> str:
    """What an error says, in one line; its kind before it where it is none for users."""
    words = " ".join(str(error).split())
    if isinstance(error, UserError):
        return words
    return f"{type(error).__name__}: {words}" if words else type(error).__name__


class Attempts:
    """Figures of a part that are tried one by one: what fails is told, and the next is tried."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._tried = 0
        self._failed: list[str] = []

    @contextmanager
    def one(self, *keys: str) -> Iterator[None]:
        """Try what is inside; ``keys`` name it."""
        self._tried += 1
        try:
            yield
        except OutOfTimeError:
            raise
        except Exception as error:
            name = " ".join(keys)
            self._failed.append(f"{name}: {sentence(error)}")
            self._tell(sentence(error), "errors", name)

    def settle(self) -> None:
        """Raise UserError where any has failed."""
        if self._failed:
            count = f"{len(self._failed)} of {self._tried}"
            raise UserError(f"{count} failed, the first is {self._failed[0]}")
