"""A driver and a world without a network between them, tick by tick: what tests drive with."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from lndrl.config import RunConfig
from lndrl.evaluation import settings_for
from lndrl.localization import Scanner
from lndrl.planners import planner_source
from lndrl.robot.driving.assembly import DriveOptions, drive_config, make_driver
from lndrl.robot.driving.pilot import Pilot
from lndrl.robot.messages import Content, Velocity
from lndrl.robot.stand_in import Body
from lndrl.scenario import Scenario

ROOM = Scenario.model_validate(
    {
        "name": "room",
        "size": [9.0, 6.0],
        # A pillar and boxes, so that no two corners look alike.
        "obstacles": [{"circle": [6.5, 1.2, 0.3]}, {"box": [1.0, 4.9, 2.2, 5.4]},
                      {"box": [8.2, 4.0, 8.9, 4.4]}],
        "pedestrians": {"count": [2, 2],
                        "routes": [{"start": [3, 5, 4, 5.6], "goal": [7, 5, 8, 5.6]}]},
        "robot": [{"start": [1, 2, 2, 3], "goal": [5, 2, 6, 3]}],
    }
)  # fmt: skip
FEW = {"min_particles": 200, "max_particles": 400}
TICK = 0.1

Alter = Callable[[str, Any], Content | None]


def config_of(planner: str = "straight", **localization: Any) -> RunConfig:
    """What ``planner`` drives under, in a small room, with a small filter."""
    config = settings_for(planner_source(planner))
    changed = config.localization.model_copy(update={**FEW, **localization})
    return config.model_copy(update={"scenario": ROOM, "localization": changed})


class Rig:
    """A body, a driver, and what was sent; ``now`` is s of both clocks."""

    def __init__(
        self,
        options: DriveOptions | None = None,
        planner: str = "straight",
        scanner: Scanner | None = None,
        localizes: bool = False,
        config: RunConfig | None = None,
    ) -> None:
        self.options = options or DriveOptions()
        self.config = drive_config(config or config_of(planner), self.options)
        self.body = Body(self.config, scanner, localizes)
        self.body.begin(0)
        self.pilot = Pilot(planner_source(planner), self.config)
        self.sent: list[tuple[str, Any]] = []
        self.driver = make_driver(
            self.pilot, self.options, lambda purpose, content: self.sent.append((purpose, content))
        )
        self.now = 100.0
        self.touched = False

    @property
    def stamp(self) -> int:
        return round(self.now * 1e9)

    @property
    def reasons(self) -> list[str]:
        return [stop.reason.label for stop in self.driver.stops]

    @property
    def commands(self) -> list[tuple[float, float]]:
        return [(c.v, c.w) for purpose, c in self.sent if purpose == "command"]

    @property
    def pose_error(self) -> float:
        estimate = self.driver.senses.estimate
        assert estimate is not None
        return float(np.hypot(*(estimate.pose - self.body.pose_true)[:2]))

    def say(self, purpose: str, content: Content, stamped: float | None = None) -> None:
        """A message that comes now, when the clock shows ``stamped`` s (now)."""
        clock = self.stamp if stamped is None else round(stamped * 1e9)
        self.driver.take(purpose, content, self.now, clock)

    def begin(self, without: Collection[str] = ()) -> Rig:
        """All that is said once: map, mounting, where the robot is, and where it shall go."""
        body, stamp = self.body, self.stamp
        for purpose, content in (
            ("tf_static", body.mounting(stamp)), ("map", body.map(stamp)),
            ("initial_pose", body.initial_pose(stamp)), ("goal", body.goal_pose(stamp)),
        ):  # fmt: skip
            if purpose not in without:
                self.say(purpose, content)
        return self

    def tick(self, count: int = 1, alter: Alter | None = None) -> Rig:
        """Sensors speak, the driver answers, the world moves. ``alter`` may swallow messages."""
        for _ in range(count):
            body, stamp = self.body, self.stamp
            said: list[tuple[str, Content | None]] = [
                ("odometry", body.odometry(stamp)), ("tf", body.transforms(stamp)),
                ("people", body.people(stamp)), ("robot_pose", body.own_pose(stamp)),
                ("scan", body.scan(stamp)),
            ]  # fmt: skip
            for purpose, content in said:
                if content is not None and alter is not None:
                    content = alter(purpose, content)
                if content is not None:
                    self.say(purpose, content)
            self.driver.watch(self.now)
            self.touched = self.body.tick(*self.driver.command) or self.touched
            self.now += TICK
        return self

    def quiet(self, seconds: float) -> Rig:
        """Nobody says anything, and time passes."""
        until = self.now + seconds
        while self.now < until - 1e-9:
            self.now += 0.02
            self.driver.watch(self.now)
        return self

    def last_command(self) -> Velocity:
        found: Velocity = [content for purpose, content in self.sent if purpose == "command"][-1]
        return found


def without(*purposes: str) -> Alter:
    """Swallows what is said for ``purposes``."""
    return lambda purpose, content: None if purpose in purposes else content


def driving(options: DriveOptions | None = None, **given: Any) -> Rig:
    """A rig that drives, and has no reason not to."""
    rig = Rig(options, **given).begin().tick(6)
    assert rig.reasons == [] and rig.driver.command[0] > 0.0
    return rig


def stands(rig: Rig, reason: str) -> None:
    """Asserts that it stands, and was told so, for ``reason`` among others."""
    assert reason in rig.reasons, rig.reasons
    assert rig.driver.command == (0.0, 0.0) and rig.commands[-1] == (0.0, 0.0)
