"""Wandering drives: a robot that turns away from walls and people, heard by every filter alike.

Knows the filter not at all: two figures differ by the filter and nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lndrl.config import WorldConfig
from lndrl.evaluation.localization.drives import SensorLog, record
from lndrl.scenario import Obstacle, Pedestrians, RobotTask, Scenario
from lndrl.world import Place, World

_TURNS = np.linspace(-1.0, 1.0, 9)
"""rad/s that the driver may choose between."""
_LOOK_AHEAD = np.arange(0.3, 2.1, 0.3)
"""s"""

_KEEPS_WISH = 20
"""Ticks between two wishes."""


def rectangles_scenario(seed: int = 0, count: int = 25) -> Scenario:
    """A 33 x 20 m room with ``count`` solid rectangles of 0.25 to 1.5 m, nobody in it."""
    width, height = 33.0, 20.0
    rng = np.random.default_rng(seed)
    boxes = []
    for _ in range(count):
        size = rng.uniform(0.25, 1.5, 2)
        low = rng.uniform(0.5, np.array([width, height]) - 0.5 - size)
        boxes.append(Obstacle(box=(*map(float, low), *map(float, low + size))))
    anywhere = (0.5, 0.5, width - 0.5, height - 0.5)
    return Scenario(
        name="rectangles",
        size=(width, height),
        obstacles=boxes,
        pedestrians=Pedestrians(count=(0, 0)),
        robot=[RobotTask(start=anywhere, goal=anywhere)],
    )


def record_drives(
    place: Place,
    config: WorldConfig,
    drives: int = 10,
    updates: int = 200,
    speed: float = 0.6,
    seed: int = 1,
) -> list[SensorLog]:
    """Drive ``place`` at ``speed`` m/s, turning away from walls and people; fixed by ``seed``.

    Starts are the scenario's; slip is drawn anew for every update, as ``odometry_deviation`` says.
    """
    logs = []
    for number in range(drives):
        world = World(place, config)
        world.reset(seed, 0, number)
        wanderer = Wanderer(place, speed, np.random.default_rng((seed, number)))
        logs.append(record(world, wanderer.command, updates, every=1))
    return logs


@dataclass
class Wanderer:
    """A driver that wishes for a random turn now and then, and takes what keeps clear."""

    place: Place
    speed: float
    rng: np.random.Generator
    wish: float = field(default=0.0, init=False)
    ticks: int = field(default=0, init=False)

    def command(self, world: World) -> tuple[float, float]:
        """v (m/s) and w (rad/s) of the next tick."""
        if self.ticks % _KEEPS_WISH == 0:
            self.wish = self.rng.uniform(-0.7, 0.7)
        self.ticks += 1
        return self.speed, _turn(self.place, world, self.speed, self.wish)


def _turn(place: Place, world: World, speed: float, wish: float) -> float:
    """The turn rate (rad/s) nearest to ``wish`` whose arc keeps clear, else the clearest."""
    enough = world.config.robot_radius + 0.15
    best, best_score = 0.0, -math.inf
    for turn in _TURNS:
        score = min(_room(place, world, speed, float(turn)), enough) * 100.0 - abs(turn - wish)
        if score > best_score:
            best, best_score = float(turn), score
    return best


def _room(place: Place, world: World, speed: float, turn: float) -> float:
    x, y, yaw = world.pose_true
    room = math.inf
    for t in _LOOK_AHEAD:
        middle = yaw + 0.5 * turn * t
        ahead = np.array([x + speed * t * math.cos(middle), y + speed * t * math.sin(middle)])
        room = min(room, place.room(ahead[0], ahead[1]))
        if world.pedestrian_count:
            people = world.pedestrian_position + t * world.pedestrian_velocity
            room = min(room, float(np.hypot(*(people - ahead).T).min()) - 0.3)
    return room
