"""``lndrl drive``: a policy drives a ROS 2 robot, from a machine without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from lndrl.cli.options import (
    GuardSettings,
    PlannerSettings,
    ShieldOption,
    ShieldSettings,
    Temperature,
    TrustModules,
    WhichCheckpoint,
    check_endpoint,
    part_settings,
    shield_config,
    trust,
)
from lndrl.cli.robot.arguments import (
    DialectOption,
    DistributionOption,
    DomainOption,
    FilterOption,
    GuardSwitch,
    NamespaceOption,
    OverlayOption,
    RobotOption,
    TopicOption,
    drive_guard,
    numbers_in,
    robot_named,
    scanner_in,
    topics_of,
)
from lndrl.errors import UserError


def drive(
    policy: Annotated[
        str,
        typer.Argument(
            metavar="POLICY",
            help="Run folder, weights file, 'shipped', 'predictive', 'careful', 'careful+map',"
            " 'dwa' or module:Class.",
        ),
    ],
    connect: Annotated[
        str, typer.Option("--connect", metavar="ENDPOINT", help="The robot's Zenoh router.")
    ] = "tcp/127.0.0.1:7447",
    goal: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="Drive there and leave; else goals come from /goal_pose.",
            show_default=False,
        ),
    ] = None,
    pose: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEGREES",
            help="Where the robot is; else from /initialpose.",
            show_default=False,
        ),
    ] = None,
    localization: Annotated[
        Literal["own", "robot"],
        typer.Option(help="Our particle filter, or what the robot says on /amcl_pose."),
    ] = "own",
    filter_: FilterOption = "robot",
    robot: RobotOption = None,
    guard: GuardSwitch = True,
    guard_set: GuardSettings = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE.yaml", help="A map of your own.", show_default=False),
    ] = None,
    scanner: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEGREES[,upside-down]",
            help="Where the scanner is on the base; else from /tf_static.",
            show_default=False,
        ),
    ] = None,
    people: Annotated[
        Literal["tracked", "none"], typer.Option(help="Listen to people trackers, or not.")
    ] = "tracked",
    enable_topic: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Deadman: drive only while this std_msgs/Bool says true.",
            show_default=False,
        ),
    ] = None,
    enable_button: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="The topic is a sensor_msgs/Joy; hold its button N.",
            show_default=False,
        ),
    ] = None,
    max_speed: Annotated[float | None, typer.Option(metavar="M/S", show_default=False)] = None,
    max_turn: Annotated[float | None, typer.Option(metavar="RAD/S", show_default=False)] = None,
    acceleration: Annotated[float | None, typer.Option(metavar="M/S2", show_default=False)] = None,
    turn_acceleration: Annotated[
        float | None, typer.Option(metavar="RAD/S2", show_default=False)
    ] = None,
    stale: Annotated[
        float, typer.Option(metavar="S", help="Stop when scan or odometry are older.")
    ] = 0.35,
    sim_time: Annotated[
        Literal["auto", "on", "off"],
        typer.Option(help="Time from /clock; auto: if anybody publishes one."),
    ] = "auto",
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.mcap", help="Record all that was heard and said.", show_default=False
        ),
    ] = None,
    dialect: DialectOption = None,
    distribution: DistributionOption = None,
    domain: DomainOption = 0,
    namespace: NamespaceOption = "",
    topic: TopicOption = None,
    seconds: Annotated[
        float | None,
        typer.Option("--for", metavar="S", help="Leave after so long.", show_default=False),
    ] = None,
    greedy: Annotated[
        bool, typer.Option("--greedy", help="Take the likeliest action instead of sampling.")
    ] = False,
    temperature: Temperature = None,
    seed: Annotated[int, typer.Option(metavar="SEED", min=0)] = 0,
    checkpoint: WhichCheckpoint = None,
    planner_set: PlannerSettings = None,
    shield: ShieldOption = False,
    shield_set: ShieldSettings = None,
    trust_modules: TrustModules = None,
    timeout: Annotated[
        float, typer.Option(metavar="S", min=0.1, help="Wait so long for the robot to answer.")
    ] = 5.0,
    zenoh: OverlayOption = None,
    plain: Annotated[bool, typer.Option("--plain", help="Lines instead of a screen.")] = False,
    json: Annotated[bool, typer.Option("--json", help="What it came to, as JSON.")] = False,
) -> None:
    """Drive a ROS 2 robot by a policy, over Zenoh, from a machine without ROS.

    The robot needs a Zenoh router (rmw_zenohd) or zenoh-bridge-ros2dds. It stands whenever anything
    is wrong, and says why (docs/robot.md). Ctrl-C stops it. Neither the policy nor the guard is a
    safety device: keep the robot's emergency stop at hand.
    """
    from lndrl.cli.robot.session import DriveSession
    from lndrl.robot.driving import Limits, Trust
    from lndrl.robot.driving.assembly import DriveOptions
    from lndrl.robot.fitting import fitted_limits
    from lndrl.robot.link import Address, Topic

    if enable_button is not None and enable_topic is None:
        raise UserError(f"--enable-button {enable_button} goes with --enable-topic, e.g. /joy")
    if enable_topic is not None:
        Topic(enable_topic, "std_msgs/msg/Bool")
    if not 0.05 <= stale <= 5.0:
        raise UserError(f"--stale {stale:g}: must be 0.05 to 5 s")
    shape = robot_named(robot)
    asked = Limits(max_speed, max_turn, acceleration, turn_acceleration)
    options = DriveOptions(
        topics=topics_of(topic, namespace, shape),
        localization=localization,
        preset=filter_,
        map_file=map_file,
        robot=shape,
        guard=drive_guard(guard, guard_set, shape),
        people=people == "tracked",
        enable_topic=enable_topic,
        enable_button=enable_button,
        limits=fitted_limits(asked, shape),
        trust=Trust(stale=stale),
        sim_time=sim_time,
        greedy=greedy,
        seed=seed,
        **_places(pose, goal, scanner),
    )
    address = Address(
        check_endpoint(connect, "--connect"), dialect, distribution, domain, zenoh, timeout
    )
    trust(trust_modules)
    source = _source(policy, planner_set, checkpoint, shield, shield_set, temperature, greedy)
    session = DriveSession(source, options, address, record, seconds)
    session.note(robot, asked)
    session.run(plain, json)


def _places(pose: str | None, goal: str | None, scanner: str | None) -> dict[str, Any]:
    """The places that were given, in m and rad."""
    import math

    found: dict[str, Any] = {}
    if pose is not None:
        x, y, degrees = numbers_in(pose, 3, "--pose", "1.0,2.0,90")
        found["pose"] = x, y, math.radians(degrees)
    if goal is not None:
        found["goal"] = numbers_in(goal, 2, "--goal", "4.0,1.5")
    if scanner is not None:
        found["scanner"] = scanner_in(scanner)
    return found


def _source(
    policy: str,
    settings: list[str] | None,
    checkpoint: str | None,
    shield: bool,
    shield_set: list[str] | None,
    temperature: float | None,
    greedy: bool,
) -> Any:
    from lndrl.cli.sources import planner_sources

    (source,) = planner_sources(
        [policy], part_settings(settings, "--planner-set"), checkpoint,
        shield_config(shield, shield_set), temperature, greedy,
    )  # fmt: skip
    return source
