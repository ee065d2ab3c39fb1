"""A drive put together from what a user asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from lndrl.config import LocalizationConfig, RunConfig
from lndrl.config.localization import PRESETS
from lndrl.errors import UserError
from lndrl.localization import Scanner
from lndrl.maps.ros_map import load_ros_map
from lndrl.planners import GuardConfig, PlannerSource
from lndrl.robot.driving.belief import OwnLocalization, RobotLocalization
from lndrl.robot.driving.driver import Driver, Send
from lndrl.robot.driving.guarding import DriveGuard
from lndrl.robot.driving.maps import RobotMap
from lndrl.robot.driving.pilot import Pilot
from lndrl.robot.driving.senses import Senses, Trust
from lndrl.robot.driving.service import DriveService, Wanted
from lndrl.robot.fitting import guarded_base
from lndrl.robot.limits import Limits
from lndrl.robot.link import Link, Topic
from lndrl.robot.messages import StampedPose, names
from lndrl.robot.recording import Recorder
from lndrl.robot.shapes import RobotShape
from lndrl.robot.topics import Topics

TRAINED = "trained"
SimTime = Literal["auto", "on", "off"]


@dataclass(frozen=True)
class DriveOptions:
    """Everything about a drive but the policy and the link."""

    topics: Topics = field(default_factory=Topics)
    localization: Literal["own", "robot"] = "own"
    preset: str | None = None
    """Of our filter's settings; None, and ``TRAINED``: as the policy was trained."""
    pose: tuple[float, float, float] | None = None
    goal: tuple[float, float] | None = None
    map_file: Path | None = None
    robot: RobotShape | None = None
    """What it is like; None: as the one that the policy was trained with."""
    scanner: Scanner | None = None
    """How it stands on the base; None: as ``robot`` says, else by TF."""
    guard: GuardConfig | None = None
    """Bounds of the guard that every command goes through; None: there is none."""
    people: bool = True
    enable_topic: str | None = None
    enable_button: int | None = None
    """Of a joystick (sensor_msgs/Joy); None: the topic is a std_msgs/Bool."""
    limits: Limits = field(default_factory=Limits)
    trust: Trust = field(default_factory=Trust)
    sim_time: SimTime = "auto"
    greedy: bool = False
    seed: int = 0


def drive_config(config: RunConfig, options: DriveOptions) -> RunConfig:
    """What a policy of ``config`` is driven under: the filter that was asked for, and a pose that
    is heard at once. Raises UserError for an unknown preset, and a filter that knows the truth.
    """
    filter_ = config.localization
    if options.preset not in (None, TRAINED):
        known = ", ".join([*(name for name in PRESETS if name != "perfect"), TRAINED])
        if options.preset not in PRESETS or options.preset == "perfect":
            raise UserError(f"--filter {options.preset}: is unknown; known: {known}")
        filter_ = LocalizationConfig.model_validate(options.preset)
    if filter_.kind == "perfect":
        raise UserError("a robot's pose is never known exactly; say --filter best")
    filter_ = filter_.model_copy(update={"delay": 0, "update_ticks": None})
    return config.model_copy(update={"localization": filter_})


def make_pilot(source: PlannerSource, config: RunConfig, options: DriveOptions) -> Pilot:
    """The planner of ``source``, compiled and ready; ``config`` is ``drive_config``'s."""
    pilot = Pilot(source, config, options.greedy, options.seed)
    pilot.warm_up()
    if options.localization == "own":
        OwnLocalization(config, options.seed).warm_up()
    return pilot


def make_driver(pilot: Pilot, options: DriveOptions, send: Send) -> Driver:
    """What drives by ``pilot``. Raises UserError for a map file that cannot be read."""
    config, robot = pilot.config, options.robot
    localization = (
        OwnLocalization(config, options.seed)
        if options.localization == "own"
        else RobotLocalization(config)
    )
    radius = float(config.world.robot_radius) if robot is None else robot.reach
    map_ = None
    if options.map_file is not None:
        map_ = RobotMap.of_grid("map", load_ros_map(options.map_file).grid, radius)
    mount, limits = options.scanner, None
    if robot is not None:
        mount = mount or robot.scanner.scanner()
        limits = float(robot.scanner.range_min), float(robot.scanner.range_max)
    senses = Senses(
        localization, radius, options.trust, mount, limits, map_,
        options.enable_topic is not None, options.enable_button or 0,
    )  # fmt: skip
    goal = None
    if options.goal is not None:
        goal = StampedPose(0, "", np.array([*options.goal, 0.0]))
    driver = Driver(pilot, senses, send, options.limits, _guard(pilot, options, radius), goal)
    if options.pose is not None:
        senses.give_pose(StampedPose(0, "", np.array(options.pose)))
    return driver


def make_service(
    link: Link,
    pilot: Pilot,
    options: DriveOptions,
    recorder: Recorder | None = None,
) -> DriveService:
    """A live drive over ``link``."""
    topics = options.topics
    enable = None
    if options.enable_topic is not None:
        type_ = names.SWITCH if options.enable_button is None else names.JOYSTICK
        enable = Topic(options.enable_topic, type_)
    wanted = Wanted(
        topics=topics,
        own_map=options.map_file is not None,
        people=options.people,
        enable=enable,
        simulated=is_simulated(link, options),
        stamped=options.robot is not None and options.robot.topics.stamped,
    )
    return DriveService(link, lambda send: make_driver(pilot, options, send), wanted, recorder)


def is_simulated(link: Link, options: DriveOptions) -> bool:
    """Whether time is a simulation's: as said, else where somebody publishes a clock."""
    if options.sim_time != "auto":
        return options.sim_time == "on"
    clock = options.topics.clock
    return any(each.kind == "publisher" and each.topic == clock for each in link.endpoints())


def _guard(pilot: Pilot, options: DriveOptions, radius: float) -> DriveGuard | None:
    if options.guard is None:
        return None
    base = guarded_base(options.robot, radius)
    return DriveGuard(options.guard, base, pilot.actions, pilot.period)
