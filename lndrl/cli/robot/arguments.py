"""Options that the commands for robots share, and the checks of their text."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.localization import Scanner
    from lndrl.planners import GuardConfig
    from lndrl.robot.shapes import RobotShape
    from lndrl.robot.topics import Topics

Dialect = Literal["rmw", "bridge"]
Distribution = Literal["humble", "jazzy", "kilted"]

DialectOption = Annotated[
    Dialect | None,
    typer.Option(
        help="How ROS 2 speaks Zenoh: rmw_zenoh, or zenoh-bridge-ros2dds. Default: what is found.",
        show_default=False,
    ),
]
DistributionOption = Annotated[
    Distribution | None,
    typer.Option(
        help="ROS 2 distribution of the robot. Default: what is found.", show_default=False
    ),
]
DomainOption = Annotated[
    int, typer.Option("--domain", metavar="N", min=0, max=232, help="ROS_DOMAIN_ID (rmw).")
]
NamespaceOption = Annotated[
    str,
    typer.Option(
        "--namespace", metavar="NAME", help="Topics are /NAME/scan and so on.", show_default=False
    ),
]
TopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="FOR=NAME",
        help="Another topic, e.g. scan=/lidar/scan or command=/cmd_vel_mux/input/navi; can be"
        " repeated.",
        show_default=False,
    ),
]
RobotOption = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="NAME|FILE",
        help="What it is like: turtlebot2, turtlebot3-burger, turtlebot4, generic, or a YAML file:"
        " size, speeds, accelerations, scanner, topics. Other options win.",
        show_default=False,
    ),
]
FilterOption = Annotated[
    str,
    typer.Option(
        "--filter",
        metavar="PRESET",
        help="Of our filter: robot, best, paper; trained: as the policy was trained.",
    ),
]
GuardSwitch = Annotated[
    bool,
    typer.Option(
        "--guard/--no-guard",
        help="Let no command through that could end in a touch of what is seen (docs/guard.md).",
    ),
]
OverlayOption = Annotated[
    Path | None,
    typer.Option(
        "--zenoh", metavar="FILE", help="JSON5 file of zenoh settings, applied last.",
        show_default=False,
    ),
]  # fmt: skip


def topics_of(topic: list[str] | None, namespace: str, robot: RobotShape | None = None) -> Topics:
    """The topics that ``--topic`` and ``--namespace`` ask for, else those of ``robot``.

    Raises UserError.
    """
    from lndrl.robot.fitting import fitted_topics
    from lndrl.robot.link import RELIABLE, Topic

    changes = {}
    for text in topic or []:
        purpose, equals, name = text.partition("=")
        if not equals:
            raise UserError(f"--topic {text}: must be FOR=NAME, e.g. scan=/lidar/scan")
        changes[purpose] = Topic(name, "std_msgs/msg/String", RELIABLE).name
    space = namespace.strip("/")
    if space:
        Topic(f"/{space}", "std_msgs/msg/String")
    return fitted_topics(robot).within(space).renamed(changes)


def robot_named(name: str | None) -> RobotShape | None:
    """The robot of ``--robot``; raises UserError."""
    from lndrl.robot.shapes import load_shape

    return None if name is None else load_shape(name)


def drive_guard(
    wanted: bool, settings: list[str] | None, robot: RobotShape | None
) -> GuardConfig | None:
    """The guard that ``--guard`` and ``--guard-set`` ask for; raises UserError."""
    from lndrl.cli.options import part_settings
    from lndrl.robot.fitting import guard_bounds

    if not wanted:
        if settings:
            raise UserError("--guard-set goes with the guard, which --no-guard turns off")
        return None
    return guard_bounds(robot, part_settings(settings, "--guard-set"))


def numbers_in(text: str, count: int, option: str, example: str) -> tuple[float, ...]:
    """``count`` finite numbers separated by commas; raises UserError."""
    parts = text.split(",")
    try:
        found = tuple(float(part) for part in parts)
    except ValueError:
        found = ()
    if len(found) != count or not all(math.isfinite(each) for each in found):
        raise UserError(f"{option} {text}: must be {count} numbers, e.g. {option} {example}")
    return found


def scanner_in(text: str) -> Scanner:
    """``X,Y,YAW`` (m, m, degrees), perhaps with ``,upside-down``; raises UserError."""
    from lndrl.localization import Scanner

    upside_down = text.endswith(",upside-down")
    x, y, yaw = numbers_in(
        text.removesuffix(",upside-down"), 3, "--scanner", "0.1,0,180 or 0.1,0,180,upside-down"
    )
    return Scanner(x, y, math.radians(yaw), upside_down)
