"""What may leave for the wheels: within the robot's speeds, and not faster changed than it can."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lndrl.errors import UserError
from lndrl.world.odometry import follow


@dataclass(frozen=True)
class Limits:
    """Largest speeds (m/s, rad/s) and accelerations (m/s², rad/s²); None: as the policy asks.

    ``braking``: None: as ``acceleration``. Raises UserError for what is not above 0.
    """

    speed: float | None = None
    turn: float | None = None
    acceleration: float | None = None
    turn_acceleration: float | None = None
    braking: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UserError(f"limit {name.replace('_', ' ')} {value:g}: must be above 0")

    def within(
        self, asked: tuple[float, float], last: tuple[float, float], seconds: float
    ) -> tuple[float, float]:
        """``asked`` v and w, no more than allowed, ``seconds`` after ``last`` was sent."""
        seconds = max(seconds, 0.0)
        v, w = _at_most(asked[0], self.speed), _at_most(asked[1], self.turn)
        if self.acceleration is not None or self.braking is not None:
            gain = math.inf if self.acceleration is None else self.acceleration
            v = float(follow(last[0], v, gain, self.braking or gain, seconds))
        if self.turn_acceleration is not None:
            turn = self.turn_acceleration
            w = float(follow(last[1], w, turn, turn, seconds))
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


def _at_most(asked: float, most: float | None) -> float:
    return asked if most is None else min(max(asked, -most), most)
