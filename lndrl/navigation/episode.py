"""What is written down about a finished episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from lndrl.navigation.reward import REWARD_PARTS
from lndrl.navigation.track import Track

Outcome = Literal["arrived", "collided", "lost", "timeout"]
OUTCOMES: tuple[str, ...] = get_args(Outcome)
_LARGEST = 1e12  # of any figure; sums over many episodes stay finite


@dataclass(frozen=True)
class EpisodeRecord:
    """One finished episode: how it ended and the sums behind the paper's metrics.

    time in s, distance in m along the true path, position_error (m), angle_error (rad) and
    variance_sum (raw var_x + var_y + var_yaw) as means over the control steps ("after each
    action is performed", PAPER §IV-B), episode_return undiscounted, reward_parts its summands.
    """

    world: int
    episode: int
    outcome: Outcome
    steps: int
    time: float
    distance: float
    position_error: float
    angle_error: float
    variance_sum: float
    episode_return: float
    reward_parts: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Plain types for the wire."""
        return {**vars(self), "reward_parts": dict(self.reward_parts)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], terms: Sequence[str] = ()) -> EpisodeRecord:
        """Read ``to_dict``'s output; raises ValueError that names the first wrong field.

        ``terms`` are the names of the run's own reward terms.
        """
        if not isinstance(data, Mapping) or set(data) != set(cls.__dataclass_fields__):
            raise ValueError(f"an episode record needs the keys {list(cls.__dataclass_fields__)}")
        for name in ("world", "episode", "steps"):
            if type(data[name]) is not int or not 0 <= data[name] < 2**53:
                raise ValueError(f"episode record: {name} must be a whole number from 0")
        if not isinstance(data["outcome"], str) or data["outcome"] not in OUTCOMES:
            raise ValueError(f"episode record: outcome must be one of {', '.join(OUTCOMES)}")
        for name in ("time", "distance", "position_error", "angle_error", "variance_sum"):
            if not _is_finite(data[name]) or data[name] < 0:
                raise ValueError(f"episode record: {name} must be a finite number from 0")
        if not _is_finite(data["episode_return"]):
            raise ValueError("episode record: episode_return must be a finite number")
        parts, names = data["reward_parts"], [*REWARD_PARTS, *terms]
        if not isinstance(parts, Mapping) or set(parts) != set(names):
            raise ValueError(f"episode record: reward_parts needs the keys {names}")
        if not all(_is_finite(value) for value in parts.values()):
            raise ValueError("episode record: reward_parts must be finite numbers")
        return cls(**{**data, "reward_parts": dict(parts)})


class EpisodeTally:
    """Sums of one episode, read from its ``Track``."""

    def __init__(self, track: Track) -> None:
        self._track = track
        self.sums = track.sums

    @property
    def episode_return(self) -> float:
        """Undiscounted sum of what the compiled parts of the reward have paid so far."""
        return float(self.sums[:6].sum())

    def record(
        self,
        world: int,
        episode: int,
        outcome: Outcome,
        time: float,
        own: Mapping[str, float] | None = None,
    ) -> EpisodeRecord:
        """The record of the episode so far; needs at least one step.

        ``own`` are the sums of what reward terms of the user's own have paid in it, by name.
        """
        own = own or {}
        steps = int(self._track.steps[0])
        position_error, angle_error, variance_sum = (self.sums[6:] / steps).tolist()
        return EpisodeRecord(
            world=world,
            episode=episode,
            outcome=outcome,
            steps=steps,
            time=float(time),
            distance=float(self._track.distance[0]),
            position_error=position_error,
            angle_error=angle_error,
            variance_sum=variance_sum,
            episode_return=self.episode_return + sum(own.values()),
            reward_parts={**dict(zip(REWARD_PARTS, self.sums[:6].tolist(), strict=True)), **own},
        )


def _is_finite(value: Any) -> bool:
    # NaN fails every comparison.
    return isinstance(value, float | int) and type(value) is not bool and abs(value) <= _LARGEST
