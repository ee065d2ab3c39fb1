"""What may leave for the wheels: within the robot's speeds, and not faster changed than it can."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lndrl.errors import UserError


@dataclass(frozen=True)
class Limits:
    """Largest speeds (m/s, rad/s) and accelerations (m/s², rad/s²); None: as the policy asks.

    Raises UserError for what is not above 0.
    """

    speed: float | None = None
    turn: float | None = None
    acceleration: float | None = None
    turn_acceleration: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UserError(f"limit {name.replace('_', ' ')} {value:g}: must be above 0")

    def within(
        self, asked: tuple[float, float], last: tuple[float, float], seconds: float
    ) -> tuple[float, float]:
        """``asked`` v and w, no more than allowed, ``seconds`` after ``last`` was sent."""
        v = _held(asked[0], last[0], self.speed, self.acceleration, seconds)
        w = _held(asked[1], last[1], self.turn, self.turn_acceleration, seconds)
        return v, w

    def notes(self, fastest: tuple[float, float]) -> list[str]:
        """Where the policy, whose actions go up to ``fastest`` (m/s, rad/s), is held back."""
        found = []
        for what, unit, most, limit in (
            ("drive at", "m/s", fastest[0], self.speed),
            ("turn at", "rad/s", fastest[1], self.turn),
        ):
            if limit is not None and limit < most - 1e-9:
                found.append(
                    f"the policy may {what} {most:g} {unit}, the robot at {limit:g}: it was trained"
                    " for what it cannot do here, and does not know it"
                )
        return found


def _held(
    asked: float, last: float, most: float | None, change: float | None, seconds: float
) -> float:
    if most is not None:
        asked = min(max(asked, -most), most)
    if change is not None:
        step = change * max(seconds, 0.0)
        asked = min(max(asked, last - step), last + step)
    return asked
