"""A small world against the guard: bodies that do their worst within its bounds, and a count.

Not the world of training: bodies here move as they like, at the most that the guard is told, at
whoever drives; the robot drives at goals without minding anybody. Whatever the guard lets through
and the robot then touches while it moves is counted, by whether the body was seen.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.localization import Scanner
from lndrl.maps.grid import OccupancyGrid
from lndrl.planners.guard import GuardConfig
from lndrl.robot.guard import CommandGuard, Sight
from lndrl.world.odometry import Limits, accelerate, drive

Floats = NDArray[np.float64]

SIDE = 12.0  # m of the square, a wall all around
_WALL = 0.5  # m, how thick it is on the map
_RESOLUTION = 0.05  # m
_CHANGE = 30  # ticks after which a body takes up another way to be in the way
_AGAIN = 4.0  # m from the robot at least, where a body begins anew
WAYS = ("chase", "meet", "cross", "wander", "stand")


@dataclass(frozen=True)
class Adversity:
    """What a run is made of; lengths m, times s.

    ``bodies`` discs of ``GuardConfig.body`` / 2 radius walk at ``GuardConfig.people_speed`` at the
    most. Readings err by up to ``GuardConfig.noise``; a share ``missed`` of them is none, and
    ``random`` of them anything. ``latency`` (ticks): from a scan to the moment its command holds.
    ``holds`` (ticks): how long a command may hold, where another may come with every step before;
    None: for the step.
    """

    bodies: int = 6
    beams: int = 180
    field_of_view: float = math.pi
    range_max: float = 12.0
    radius: float = 0.17
    tick: float = 0.1
    ticks_per_step: int = 4
    latency: int = 0
    holds: int | None = None
    limits: Limits | None = None
    missed: float = 0.01
    random: float = 0.01
    fastest: float = 0.6
    ways: tuple[str, ...] = WAYS


@dataclass
class Tally:
    """What happened in ``steps`` control steps.

    ``stood`` and ``would_stand``: steps in which the robot got, and was meant to get, no speed.
    ``vetoed``: steps whose command was vetoed. ``seen``: touches, while the robot moved, of
    bodies that the scan showed when the command was let through; ``unseen``: of others;
    ``walls``: of the wall; ``walked_into``: touches of a standing robot, which are not its own.
    """

    steps: int = 0
    stood: int = 0
    would_stand: int = 0
    vetoed: int = 0
    seen: int = 0
    unseen: int = 0
    walls: int = 0
    walked_into: int = 0
    goals: int = 0

    @property
    def standing(self) -> float:
        """Share of the steps in which it stood though it was not meant to."""
        return (self.stood - self.would_stand) / max(self.steps, 1)

    def to_dict(self) -> dict[str, Any]:
        """Plain types under the field names."""
        return {**asdict(self), "standing": self.standing}


@dataclass
class Arena:
    """The world of one run; ``step`` goes on by one control step."""

    parameters: GuardConfig
    made: Adversity
    random: np.random.Generator
    guard_on: bool = True
    tally: Tally = field(default_factory=Tally)

    def __post_init__(self) -> None:
        made = self.made
        table = [(v, w) for v in (0.0, 0.2, 0.4, 0.6) for w in (-0.9, -0.6, -0.3, 0, 0.3, 0.6, 0.9)]
        self.choices = np.array(table, np.float64)
        self.choices[:, 0] *= made.fastest / 0.6
        self.scanner = Scanner(range_max=made.range_max)
        self.bearings = made.field_of_view * ((np.arange(made.beams) + 0.5) / made.beams - 0.5)
        holds = made.holds or made.ticks_per_step
        self.guard = CommandGuard(
            self.parameters, made.radius, made.limits, self.choices, made.tick * holds, made.tick,
            square(), revised=holds > made.ticks_per_step,
        )  # fmt: skip
        self.limits = made.limits or (math.inf, math.inf, math.inf)
        self.pose, self.velocity, self.command = np.zeros(3), np.zeros(2), np.zeros(2)
        self.goal = self._somewhere()
        self.place = np.array([self._away() for _ in range(made.bodies)]).reshape(-1, 2)
        self.way = np.array([self._draw_way() for _ in range(made.bodies)], dtype=np.int64)
        self.turn = self.random.uniform(-math.pi, math.pi, made.bodies)
        self.age = self.random.integers(_CHANGE, size=made.bodies)
        self.touching = np.zeros(made.bodies, np.bool_)
        self.at_wall = False
        self.covered: set[int] = set()
        self.waiting: list[tuple[int, Floats, set[int] | None]] = []

    def step(self) -> None:
        """Scan, decide, and drive for a control step."""
        made, tally = self.made, self.tally
        ranges, owner = self._scan()
        sight = self.guard.look(ranges, self.bearings, self.scanner, self.pose)
        wanted = self._wanted()
        told, passed = wanted, True
        if self.guard_on:
            pose, velocity = self._then()
            age = made.latency * made.tick - self.parameters.delay
            told, passed = self.guard.check(wanted, velocity, sight, pose, age)
        seen = shown(sight, owner) | self._met(ranges, owner)
        self.waiting.append((made.latency, told, seen))
        tally.steps += 1
        tally.vetoed += not passed
        tally.stood += float(told[0]) == 0.0
        tally.would_stand += float(wanted[0]) == 0.0
        for _ in range(made.ticks_per_step):
            self._tick()
        if math.hypot(*(self.goal - self.pose[:2])) < 0.5:
            self.goal = self._somewhere()
            tally.goals += 1

    def _then(self) -> tuple[Floats, Floats]:
        """Where the robot will be, as seen from where it is, and its velocity, when the command of
        this scan takes effect: what is already told it drives until then.
        """
        pose, velocity, command = np.zeros(3), self.velocity.copy(), self.command
        coming = list(self.waiting)
        for k in range(self.made.latency):
            for left, later, _ in coming:
                command = later if left == k else command
            accelerate(velocity, command, self.limits, self.made.tick)
            drive(pose, velocity[0], velocity[1], self.made.tick)
        return pose, velocity

    def _tick(self) -> None:
        made = self.made
        due = [each for each in self.waiting if each[0] == 0]
        self.waiting = [(left - 1, *rest) for left, *rest in self.waiting if left > 0]  # type: ignore[misc]
        for _, command, covered in due:
            self.command = command
            # A stop lets nothing new through: it drives what an earlier command came with.
            if covered is not None and command[0] != 0.0:
                self.covered = covered
        self._move_bodies()
        accelerate(self.velocity, self.command, self.limits, made.tick)
        drive(self.pose, self.velocity[0], self.velocity[1], made.tick)
        self._count()

    def _count(self) -> None:
        made, tally = self.made, self.tally
        moving = self.velocity[0] != 0.0
        near = made.radius + 0.5 * self.parameters.body - 1e-9
        touching = np.hypot(*(self.place - self.pose[:2]).T) < near
        at_wall = bool(np.abs(self.pose[:2]).max() > 0.5 * SIDE - made.radius)
        tally.walls += at_wall and not self.at_wall
        self.at_wall = at_wall
        if at_wall:  # it would stay there
            self.pose[:2] *= 0.9
        if not touching.any():
            self.touching = touching
            return
        for k in np.flatnonzero(touching & ~self.touching):
            if not moving:
                tally.walked_into += 1
            elif int(k) in self.covered:
                tally.seen += 1
            else:
                tally.unseen += 1
        self.touching = touching
        for k in np.flatnonzero(touching):
            self.place[k] = self._away()
            self.touching[k] = False
            self._forget(int(k))

    def _forget(self, body: int) -> None:
        """A body that begins anew elsewhere has not been seen there."""
        self.covered.discard(body)
        for _, _, covered in self.waiting:
            if covered is not None:
                covered.discard(body)

    def _wanted(self) -> Floats:
        """At the goal as fast as there is, turning to it on the spot where it is behind."""
        ahead = self.goal - self.pose[:2]
        off = math.remainder(math.atan2(ahead[1], ahead[0]) - self.pose[2], math.tau)
        w = max(-0.9, min(0.9, 2.0 * off))
        v = self.made.fastest if abs(off) < 1.0 else 0.0
        away = np.abs(self.choices - (v, w)).sum(axis=1)
        command: Floats = self.choices[away.argmin()].copy()
        return command

    def _move_bodies(self) -> None:
        made, most = self.made, self.parameters.people_speed * self.made.tick
        self.age += 1
        for k in np.flatnonzero(self.age % _CHANGE == 0):
            self.way[k] = self._draw_way()
            self.turn[k] = self.random.uniform(-math.pi, math.pi)
        if not made.bodies:
            return
        heading = np.array([math.cos(self.pose[2]), math.sin(self.pose[2])])
        to = self.pose[:2] - self.place
        ahead = np.zeros(made.bodies)
        meet, cross, wander, stand = (self.way == WAYS.index(way) for way in WAYS[1:])
        # Where it will be, and just before its nose.
        ahead[meet] = self.velocity[0] * np.minimum(2.0, np.hypot(*to[meet].T))
        ahead[cross] = made.radius + 0.5 * self.parameters.body
        to += ahead[:, np.newaxis] * heading
        to[wander] = np.stack((np.cos(self.turn[wander]), np.sin(self.turn[wander])), axis=1)
        far = np.maximum(np.hypot(*to.T), 1e-12)
        share = np.where(stand, 0.0, np.minimum(most, far) / far)
        room = 0.5 * SIDE - 0.5 * self.parameters.body
        np.clip(self.place + share[:, np.newaxis] * to, -room, room, out=self.place)

    def _draw_way(self) -> int:
        ways = self.made.ways
        return WAYS.index(ways[int(self.random.integers(len(ways)))])

    def _scan(self) -> tuple[Floats, NDArray[np.int64]]:
        """Ranges (beams,) m with their errors, and the body that each beam truly met, -1: none."""
        made = self.made
        angle = self.pose[2] + self.bearings
        ray = np.stack((np.cos(angle), np.sin(angle)), axis=1)
        with np.errstate(divide="ignore"):
            walls = (np.sign(ray) * 0.5 * SIDE - self.pose[:2]) / ray
        ranges = np.abs(walls).min(axis=1)
        owner = np.full(made.beams, -1)
        if made.bodies:
            to = self.place - self.pose[:2]
            along = ray @ to.T
            aside = (to**2).sum(axis=1) - along**2
            inside = (0.5 * self.parameters.body) ** 2 - aside
            hit = along - np.sqrt(np.maximum(inside, 0.0))
            hit = np.where((inside > 0.0) & (hit > 0.0), hit, np.inf)
            nearest = hit.argmin(axis=1)
            first = hit[np.arange(made.beams), nearest]
            owner = np.where(first < ranges, nearest, -1)
            ranges = np.minimum(first, ranges)
        noise = self.parameters.noise
        ranges = np.maximum(ranges + self.random.uniform(-noise, noise, made.beams), 1e-3)
        draw = self.random.random(made.beams)
        anything = self.random.uniform(0.0, made.range_max, made.beams)
        strange = draw < made.random
        missed = ~strange & (draw < made.random + made.missed)
        owner[strange | missed] = -1
        ranges = np.where(strange, anything, np.where(missed, made.range_max, ranges))
        return np.minimum(ranges, made.range_max), owner

    def _met(self, ranges: Floats, owner: NDArray[np.int64]) -> set[int]:
        """The bodies that docs/guard.md speaks of, by the truth and whatever the guard has made of
        it: two neighbouring beams met them and agree, one of them away from the walls (A6).
        """
        if not (owner >= 0).any():
            return set()
        agree = np.abs(np.roll(ranges, -1) - ranges) <= self.parameters.pair
        both = agree & (owner >= 0) & (owner == np.roll(owner, -1))
        both &= np.maximum(ranges, np.roll(ranges, -1)) < self.made.range_max
        if self.made.field_of_view < math.tau - 1e-9:
            both[-1] = False  # the last beam has no neighbour
        both |= np.roll(both, 1)
        angle = self.pose[2] + self.bearings[both]
        at = self.pose[:2] + ranges[both, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)
        room = 0.5 * SIDE - np.abs(at).max(axis=1, initial=0.0)
        # A cell or two more, for the map has cells.
        away = room > self.parameters.map_tolerance + 2.0 * _RESOLUTION
        return {int(k) for k in owner[both][away]}

    def _somewhere(self) -> Floats:
        point: Floats = self.random.uniform(-0.5 * SIDE + 1.2, 0.5 * SIDE - 1.2, 2)
        return point

    def _away(self) -> Floats:
        """Anywhere that is far from the robot."""
        while True:
            room = 0.5 * SIDE - 0.5 * self.parameters.body
            point: Floats = self.random.uniform(-room, room, 2)
            if np.hypot(*(point - self.pose[:2])) > _AGAIN:
                return point


def shown(sight: Sight, owner: NDArray[np.int64]) -> set[int]:
    """The bodies that have an echo which the guard took for something that may move."""
    return {int(k) for k in owner[sight.beam[sight.movable]] if k >= 0}


def square() -> OccupancyGrid:
    """The map of the arena: its middle is the origin."""
    cells = round((SIDE + 2.0 * _WALL) / _RESOLUTION)
    wall = round(_WALL / _RESOLUTION)
    occupied = np.ones((cells, cells), np.bool_)
    occupied[wall:-wall, wall:-wall] = False
    corner = -0.5 * SIDE - _WALL
    return OccupancyGrid(occupied, _RESOLUTION, (corner, corner))


def contest(
    steps: int, made: Adversity, parameters: GuardConfig, seed: int, guard: bool = True
) -> Tally:
    """``steps`` control steps of one arena; the same arguments give the same tally."""
    arena = Arena(parameters, made, np.random.default_rng(seed), guard)
    for _ in range(steps):
        arena.step()
    return arena.tally
