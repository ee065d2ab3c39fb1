"""Options that the commands for robots share, and the checks of their text."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lndrl.errors import UserError

if TYPE_CHECKING:
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
OverlayOption = Annotated[
    Path | None,
    typer.Option(
        "--zenoh", metavar="FILE", help="JSON5 file of zenoh settings, applied last.",
        show_default=False,
    ),
]  # fmt: skip


def topics_of(topic: list[str] | None, namespace: str) -> Topics:
    """The topics that ``--topic`` and ``--namespace`` ask for; raises UserError."""
    from lndrl.robot.link import RELIABLE, Topic
    from lndrl.robot.topics import Topics

    changes = {}
    for text in topic or []:
        purpose, equals, name = text.partition("=")
        if not equals:
            raise UserError(f"--topic {text}: must be FOR=NAME, e.g. scan=/lidar/scan")
        changes[purpose] = Topic(name, "std_msgs/msg/String", RELIABLE).name
    space = namespace.strip("/")
    if space:
        Topic(f"/{space}", "std_msgs/msg/String")
    return Topics().within(space).renamed(changes)


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


def scanner_in(text: str) -> tuple[float, float, float, bool]:
    """``X,Y,YAW`` (m, m, degrees), perhaps with ``,upside-down``; raises UserError."""
    upside_down = text.endswith(",upside-down")
    x, y, yaw = numbers_in(
        text.removesuffix(",upside-down"), 3, "--scanner", "0.1,0,180 or 0.1,0,180,upside-down"
    )
    return x, y, math.radians(yaw), upside_down
