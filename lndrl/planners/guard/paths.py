"""A guard with a stated guarantee: it lets no command through that could end in a touch.

Let through is a command after which the robot, braking once the command's period is over, stands
before anything that the scan showed could have come within its reach, however it moves, up to a
stated speed (docs/guard.md has assumptions and proof). What the map explains is taken to stand. Who
is touched by a standing robot has walked into it. All of it is ours.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lndrl.kernels import kernel
from lndrl.models import Model, NonNegative, Positive, Probability
from lndrl.world.odometry import Limits, poses_along, velocities

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_KEPT = 64  # starting velocities whose paths are kept
_LONGEST = 30.0  # s of braking: who needs longer is not slowed by brakes


class GuardConfig(Model):
    """Bounds that the guarantee holds within (docs/guard.md); lengths in m, times in s."""

    people_speed: NonNegative = Field(
        0.5, description="m/s, the most that anything moves that is not on the map"
    )
    body: NonNegative = Field(
        0.4, description="m, the most that a body is wide, hidden parts and swinging legs included"
    )
    delay: NonNegative = Field(
        0.0, le=5.0, description="s between a scan and the moment that a command of it takes effect"
    )
    noise: NonNegative = Field(0.06, description="m by which a reading may be too long")
    margin: NonNegative = Field(
        0.02, description="m by which the robot may leave the path that its model predicts"
    )
    pair: Positive = Field(
        0.2, description="m between the readings of two neighbouring beams that bear each other out"
    )
    map_tolerance: NonNegative = Field(
        0.2, description="m from an obstacle of the map within which an echo is taken for it"
    )
    map_agreement: Probability = Field(
        0.6,
        description="share of echoes that the map must explain, or else nothing is taken for it",
    )


class Paths(NamedTuple):
    """Where commands lead, braking included: ``points`` (A, T, 2) m from the robot at ``times``
    (T,) s; ``speeds`` (A, T) m/s, the most within half a sample, 0 where it stands.
    """

    points: Floats
    speeds: Floats
    times: Floats
    half: float  # s, half of the time between two samples


class Guard:
    """Tells which commands are safe, for a robot of ``radius`` (m) around its base's middle.

    A command holds for ``period`` s, then the robot brakes within ``limits`` (None: it stands at
    once), in steps of ``tick`` s as the world does. Keeps nothing but what it computed before.
    """

    def __init__(
        self,
        parameters: GuardConfig,
        radius: float,
        limits: Limits | None,
        tick: float,
        period: float,
    ) -> None:
        self.parameters = p = parameters
        self._limits = limits or (np.inf, np.inf, np.inf)
        self._tick, self._period = tick, period
        self._still = radius + p.noise + p.margin
        self._moving = self._still + p.body
        self._known: OrderedDict[tuple[float, ...], Paths] = OrderedDict()

    def safe(
        self, commands: Floats, velocity: Floats, echoes: Floats, movable: Mask, age: float = 0.0
    ) -> Mask:
        """Which of ``commands`` (A, 2), m/s and rad/s, are safe, (A,).

        ``velocity`` (2,) of the robot now; ``echoes`` (P, 2) m in its frame, where it was when the
        scan was taken moved on to now; ``movable`` (P,): those that the map does not explain;
        ``age`` (s) of the scan beyond ``GuardConfig.delay``.
        """
        paths = self._paths(commands, velocity)
        out = np.empty(len(commands), np.bool_)
        judge_paths(
            paths.points, paths.speeds, paths.times, paths.half, echoes, movable, self._still,
            self._moving, self.parameters.people_speed, self.parameters.delay + max(age, 0.0), out,
        )  # fmt: skip
        return out

    def _paths(self, commands: Floats, velocity: Floats) -> Paths:
        key = (*np.round(velocity, 6).tolist(), *np.round(commands, 6).ravel().tolist())
        found = self._known.pop(key, None)
        if found is None:
            found = self._predict(commands, velocity)
        self._known[key] = found
        if len(self._known) > _KEPT:
            self._known.popitem(last=False)
        return found

    def _predict(self, commands: Floats, velocity: Floats) -> Paths:
        tick, loss = self._tick, self._limits[1]
        told = max(1, round(self._period / tick))
        speeds = velocities(velocity, commands, self._limits, tick, told)
        fastest = float(np.abs(speeds[:, -1, 0]).max())
        stopping = min(fastest / loss, _LONGEST)
        if stopping > 0.0:
            braking = int(np.ceil(stopping / tick + 1e-9))
            stop = np.zeros_like(commands)
            slower = velocities(speeds[:, -1], stop, self._limits, tick, braking)
            speeds = np.concatenate([speeds, slower], axis=1)
        half = 0.25 * tick
        times = 2.0 * half * np.arange(2 * speeds.shape[1] + 1)
        points = poses_along(speeds, tick, times)[..., :2]
        # Sample k lies at the start of tick k / 2, or in the middle of it; the first after the last
        # tick is its end. Around a boundary the faster of the two ticks counts.
        each = np.repeat(np.abs(speeds[..., 0]), 2, axis=1)
        around = np.zeros((len(commands), len(times)))
        around[:, :-1] = each
        around[:, 1:] = np.maximum(around[:, 1:], each)
        return Paths(np.ascontiguousarray(points), around, times, half)


@kernel()
def judge_paths(
    points, speeds, times, half, echoes, movable, still, moving, people_speed, delay, out
):
    """Write to ``out`` (A,) whether each path keeps clear of all ``echoes`` (P, 2) while it moves.

    Arguments as in ``Paths`` and ``Guard.safe``; ``still`` and ``moving`` (m): what must be kept
    from an echo that stands, and from one that moves before it has. From what stands and is nearer
    already, no path may come nearer still. A path or an echo that is not a number is not safe.
    """
    for a in range(min(out.shape[0], points.shape[0])):
        fine = True
        for k in range(points.shape[1]):
            speed = speeds[a, k]
            if speed == 0.0:
                continue
            x, y = points[a, k, 0], points[a, k, 1]
            drift = speed * half
            far = moving + drift + people_speed * (times[k] + half + delay)
            near = still + drift
            for m in range(min(echoes.shape[0], movable.shape[0])):
                dx, dy = echoes[m, 0] - x, echoes[m, 1] - y
                squared = dx * dx + dy * dy
                if movable[m]:
                    fine = fine and squared >= far * far
                else:
                    begun = echoes[m, 0] * echoes[m, 0] + echoes[m, 1] * echoes[m, 1]
                    fine = fine and squared >= min(near * near, (1.0 - 1e-9) * begun)
            if not fine:
                break
        out[a] = fine


@kernel()
def borne_out(ranges, range_max, pair, out):
    """Write which of ``ranges`` (n,) m are echoes that a neighbouring beam bears out to ``out``.

    An echo lies above 0 and below ``range_max``; neighbours within ``pair`` m of each other bear
    each other out, for a sensor makes up one reading here and there.
    """
    count = min(ranges.shape[0], out.shape[0])
    for k in range(count):
        here = ranges[k]
        good = here > 0.0 and here < range_max
        agreed = False
        for other in (k - 1, k + 1):
            if 0 <= other < count and good:
                there = ranges[other]
                if there > 0.0 and there < range_max and abs(there - here) <= pair:
                    agreed = True
        out[k] = good and agreed


@kernel()
def explained(echoes, pose, distance, inverse_resolution, tolerance, agreement, movable):
    """Write which of ``echoes`` (P, 2), m in the frame of a robot at ``pose`` (3,), may move.

    What lies within ``tolerance`` m of an obstacle by the map's ``distance`` field (m, from the
    frame's origin) stands, unless less than the share ``agreement`` does: then the pose is in
    doubt and everything may move. So may what is off the map.
    """
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    rows, columns = distance.shape
    count = min(echoes.shape[0], movable.shape[0])
    stand = 0
    for k in range(count):
        x = (pose[0] + cosine * echoes[k, 0] - sine * echoes[k, 1]) * inverse_resolution
        y = (pose[1] + sine * echoes[k, 0] + cosine * echoes[k, 1]) * inverse_resolution
        movable[k] = True
        if 0.0 <= x < columns and 0.0 <= y < rows:  # false for NaN
            movable[k] = distance[int(y), int(x)] > tolerance
        stand += not movable[k]
    if stand < agreement * count:
        for k in range(count):
            movable[k] = True
