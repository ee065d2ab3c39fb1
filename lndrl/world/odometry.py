"""Motion of the differential drive and its odometer.

The robot follows the exact unicycle arc of its velocity, which is its command, or comes as near to
it as limits on acceleration allow, tick by tick; the odometer integrates the same arc with
v and w each multiplied by a slip factor from N(1, deviation^2), drawn once per control step
(parameters §4.1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.randomness import normal

Floats = NDArray[np.float64]
Limits = tuple[float, float, float]
"""m/s² of gaining speed, m/s² of losing it, rad/s²; infinite where there is none."""


@kernel(_nrt=False)
def wrap(angle):
    """Angle (rad) in [-pi, pi)."""
    wrapped = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped if wrapped < np.pi else -np.pi  # rounding may return the open end


@kernel(_nrt=False)
def drive(pose, v, w, time):
    """Move ``pose`` [x, y, yaw] (m, rad) in place along the arc of v (m/s), w (rad/s)."""
    yaw = pose[2]
    half = 0.5 * w * time
    # Chord of the arc: v t sinc(w t / 2) in the middle direction; also exact for w = 0.
    chord = v * time
    if abs(half) > 1e-9:
        chord *= np.sin(half) / half
    pose[0] += chord * np.cos(yaw + half)
    pose[1] += chord * np.sin(yaw + half)
    pose[2] = wrap(yaw + w * time)


@kernel(_nrt=False)
def follow(speed, command, gain, loss, time):
    """``speed`` after ``time`` s on the way to ``command``, gaining and losing so much per s.

    Beyond standing still the other way is a gain. With infinite limits the command itself.
    """
    change = command - speed
    if speed * command < 0.0:
        left = time - abs(speed) / loss
        if left <= 0.0:
            return speed + np.copysign(loss * time, change)
        most = left * gain
        return command if abs(command) <= most else np.copysign(most, command)
    most = (loss if speed * change < 0.0 else gain) * time
    return command if abs(change) <= most else speed + np.copysign(most, change)


@kernel(_nrt=False)
def accelerate(velocity, command, limits, time):
    """Let ``velocity`` [v, w] follow ``command`` in place for ``time`` s.

    ``limits``: m/s² of gaining speed, m/s² of losing it, rad/s². Infinite ones hold nothing up.
    """
    velocity[0] = follow(velocity[0], command[0], limits[0], limits[1], time)
    velocity[1] = follow(velocity[1], command[1], limits[2], limits[2], time)


@kernel(_nrt=False)
def draw_slip(slip, deviation, state):
    """Fill ``slip`` [factor of v, factor of w] from N(1, deviation^2), independent."""
    slip[0] = 1.0 + deviation * normal(state)
    slip[1] = 1.0 + deviation * normal(state)


@kernel(_nrt=False)
def move_robot(pose, odometry, velocity, slip, time):
    """One tick of the robot and its odometer, both in place; ``velocity`` [v, w]."""
    drive(pose, velocity[0], velocity[1], time)
    drive(odometry, velocity[0] * slip[0], velocity[1] * slip[1], time)


# What follows is the same for many robots at a time, for whoever looks ahead.


def _followed(speed: Floats, command: Floats, gain: float, loss: float, time: float) -> Floats:
    """``speed`` after ``time`` s on the way to ``command``, any shape; as ``follow``."""
    change = command - speed
    left = np.maximum(time - np.abs(speed) / loss, 0.0)
    with np.errstate(invalid="ignore"):  # no time left and no limit: 0 times infinity
        beyond = np.where(left > 0.0, left * gain, 0.0)
    through = np.where(
        left > 0.0,
        np.sign(command) * np.minimum(np.abs(command), beyond),
        speed + np.sign(change) * np.minimum(loss * time, np.abs(change)),
    )
    most = np.where(speed * change < 0.0, loss, gain) * time
    # Where there is no limit, nothing needs to be clipped, and infinity is not added.
    most = np.minimum(most, np.abs(change))
    straight = np.where(np.abs(change) <= most, command, speed + np.sign(change) * most)
    result: Floats = np.where(speed * command < 0.0, through, straight)
    return result


def velocities(start: Floats, commands: Floats, limits: Limits, tick: float, ticks: int) -> Floats:
    """Velocities (B, ticks, 2) in each of ``ticks`` ticks of ``commands`` (B, 2) from ``start``
    (B, 2); m/s and rad/s.
    """
    out = np.empty((len(commands), ticks, 2))
    now = np.array(np.broadcast_to(start, commands.shape), dtype=np.float64)
    gain, loss, turn = limits
    for k in range(ticks):
        now[:, 0] = _followed(now[:, 0], commands[:, 0], gain, loss, tick)
        now[:, 1] = _followed(now[:, 1], commands[:, 1], turn, turn, tick)
        out[:, k] = now
    return out


def poses_along(speeds: Floats, tick: float, times: Floats) -> Floats:
    """Poses (B, T, 3) at ``times`` (T,) s of robots from the origin with ``speeds`` (B, K, 2).

    m/s and rad/s, a ``tick`` (s) each; after the last of them they go on with it.
    """
    last = speeds.shape[1] - 1
    ends = np.concatenate([np.zeros((len(speeds), 1, 3)), _chain(speeds, tick)], axis=1)
    which = np.minimum((times / tick + 1e-9).astype(np.int64), last)
    rest = times - which * tick
    part = _arc(speeds[:, which], rest[None, :])
    return _onto(ends[:, which], part)


def _arc(speeds: Floats, time: Floats) -> Floats:
    """Poses (..., 3) after ``time`` s of ``speeds`` (..., 2) from the origin, exactly."""
    v, w = speeds[..., 0], speeds[..., 1]
    half = 0.5 * w * time
    chord = v * time * np.sinc(half / np.pi)
    return np.stack((chord * np.cos(half), chord * np.sin(half), 2.0 * half), axis=-1)


def _onto(start: Floats, move: Floats) -> Floats:
    """Where ``move`` (..., 3), as seen from ``start`` (..., 3), leads."""
    c, s = np.cos(start[..., 2]), np.sin(start[..., 2])
    x = start[..., 0] + c * move[..., 0] - s * move[..., 1]
    y = start[..., 1] + s * move[..., 0] + c * move[..., 1]
    return np.stack((x, y, start[..., 2] + move[..., 2]), axis=-1)


def _chain(speeds: Floats, tick: float) -> Floats:
    """Poses (B, K, 3) at the ends of the ticks."""
    yaw = np.concatenate(
        [np.zeros((len(speeds), 1)), np.cumsum(speeds[..., 1] * tick, axis=1)[:, :-1]], axis=1
    )
    moves = _arc(speeds, np.full(1, tick))
    c, s = np.cos(yaw), np.sin(yaw)
    x = np.cumsum(c * moves[..., 0] - s * moves[..., 1], axis=1)
    y = np.cumsum(s * moves[..., 0] + c * moves[..., 1], axis=1)
    return np.stack((x, y, yaw + moves[..., 2]), axis=-1)
