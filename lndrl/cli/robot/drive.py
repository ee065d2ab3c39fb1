"""``lndrl drive``: a policy drives a ROS 2 robot, from a machine without ROS."""

from __future__ import annotations

import json as json_format
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from lndrl.cli.options import (
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
    NamespaceOption,
    OverlayOption,
    TopicOption,
    numbers_in,
    scanner_in,
    topics_of,
)
from lndrl.cli.signals import say, stop_on_signals
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.robot.driving import DriveService
    from lndrl.robot.driving.assembly import DriveOptions
    from lndrl.robot.link import Address

_STAYS = 0.5
"""s for which a robot at its only goal is told to stop, before the program leaves."""


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
    filter_: Annotated[
        str | None,
        typer.Option(
            "--filter",
            metavar="PRESET",
            help="Of our filter, e.g. best; default: as trained.",
            show_default=False,
        ),
    ] = None,
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
    is wrong, and says why (docs/robot.md). Ctrl-C stops it. The policy is no safety device: keep
    the robot's emergency stop at hand.
    """
    from lndrl.robot.driving import Limits, Trust
    from lndrl.robot.driving.assembly import DriveOptions
    from lndrl.robot.link import Address, Topic

    if enable_button is not None and enable_topic is None:
        raise UserError(f"--enable-button {enable_button} goes with --enable-topic, e.g. /joy")
    if enable_topic is not None:
        Topic(enable_topic, "std_msgs/msg/Bool")
    if not 0.05 <= stale <= 5.0:
        raise UserError(f"--stale {stale:g}: must be 0.05 to 5 s")
    given = {"pose": None, "goal": None, "scanner": None} | _places(pose, goal, scanner)
    options = DriveOptions(
        topics_of(topic, namespace), localization, filter_, given["pose"], given["goal"], map_file,
        given["scanner"], people == "tracked", enable_topic, enable_button,
        Limits(max_speed, max_turn, acceleration, turn_acceleration), Trust(stale=stale), sim_time,
        greedy, seed,
    )  # fmt: skip
    address = Address(
        check_endpoint(connect, "--connect"), dialect, distribution, domain, zenoh, timeout
    )
    trust(trust_modules)
    source = _source(policy, planner_set, checkpoint, shield, shield_set, temperature, greedy)
    _drive(source, options, address, record, seconds, plain, json)


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


def _drive(
    source: Any,
    options: DriveOptions,
    address: Address,
    record: Path | None,
    seconds: float | None,
    plain: bool,
    json: bool,
) -> None:
    from lndrl.cli.robot.live import screen
    from lndrl.evaluation import settings_for
    from lndrl.policy.acting import act_on_one_thread
    from lndrl.robot.driving.assembly import drive_config, make_pilot, make_service
    from lndrl.robot.link import open_link
    from lndrl.robot.messages import MessageStore
    from lndrl.robot.recording import Recorder
    from lndrl.view.progress import StatusLine

    config = drive_config(settings_for(source), options)
    MessageStore("jazzy")  # says what is not installed, before anything takes time
    with StatusLine() as line:
        line.update(f"loading {source.title}")
        if source.weights is not None:
            act_on_one_thread(config)
        pilot = make_pilot(source, config, options)
        line.update(f"connecting to {address.endpoint}")
        link = open_link(address, "lndrl_drive")
    for note in options.limits.notes(tuple(abs(pilot.actions).max(axis=0).tolist())):
        say(f"note: {note}")
    with ExitStack() as open_, stop_on_signals("the robot is told to stop") as stop, link:
        recorder = None
        if record is not None:
            recorder = open_.enter_context(Recorder(record, link.store))
        service = make_service(link, pilot, options, recorder)
        over = _over(service, options.goal is not None, seconds)
        head = f"{source.title} drives {address.endpoint} ({link.dialect.name})"
        with screen(head, service, plain or json) as show:
            service.run(stop, show, over)
        exit_code = stop.exit_code
    _say_result(service, recorder, json)
    if exit_code:
        raise typer.Exit(exit_code)


def _over(service: DriveService, single: bool, seconds: float | None) -> Any:
    """Whether to leave: the time is over, or the only goal reached, and the robot told so."""
    began = time.monotonic()
    arrived: list[float] = []

    def over() -> bool:
        now = time.monotonic()
        if seconds is not None and now - began >= seconds:
            return True
        if single and service.driver.arrived:
            arrived.append(now)
            return now - arrived[0] >= _STAYS
        arrived.clear()
        return False

    return over


def _say_result(service: DriveService, recorder: Any, json: bool) -> None:
    import numpy as np

    tally, latencies = service.driver.tally, np.array(service.latencies)
    content: dict[str, Any] = {
        "arrivals": tally.arrivals,
        "decisions": tally.decisions,
        "distance": tally.distance,
        "stops": tally.stops,
    }
    if len(latencies):
        median, worst = np.percentile(latencies, [50, 99]) * 1000.0
        content["latency_milliseconds"] = {"median": median, "p99": worst}
    if recorder is not None:
        content["recorded_messages"] = recorder.messages
    if json:
        typer.echo(json_format.dumps(content, indent=2))
        return
    stops = ", ".join(f"{name} {count}" for name, count in tally.stops.items())
    typer.echo(
        f"{tally.arrivals} arrived, {tally.distance:.1f} m, {tally.decisions} decisions"
        + (f", scan to command {median:.1f} ms, p99 {worst:.1f} ms" if len(latencies) else "")
        + (f"; stopped by {stops}" if stops else "")
    )
    if recorder is not None:
        typer.echo(recorder.failed or f"{recorder.messages:,} messages recorded")
