"""``lndrl robot-sim``: a robot that is not there, for rehearsals."""

from __future__ import annotations

import json as json_format
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lndrl.cli.help import say_next
from lndrl.cli.options import ScenarioName, check_endpoint
from lndrl.cli.robot.arguments import (
    DialectOption,
    DistributionOption,
    DomainOption,
    NamespaceOption,
    OverlayOption,
    RobotOption,
    TopicOption,
    numbers_in,
    robot_named,
    scanner_in,
    topics_of,
)
from lndrl.cli.signals import last_resort, say, stop_on_signals
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.config import RunConfig
    from lndrl.robot.stand_in import Conditions, DrivenEpisode

_ENDS_WITHIN = 20.0
"""s that an orderly end may take."""


def robot_sim(
    scenario: ScenarioName = None,
    listen: Annotated[
        str, typer.Option("--listen", metavar="ENDPOINT", help="Where lndrl drive connects.")
    ] = "tcp/127.0.0.1:7447",
    dialect: DialectOption = None,
    distribution: DistributionOption = None,
    domain: DomainOption = 0,
    namespace: NamespaceOption = "",
    topic: TopicOption = None,
    policy: Annotated[
        str,
        typer.Option(
            "--like",
            metavar="POLICY",
            help="World and filter as this run, weights file or 'shipped' was trained in.",
        ),
    ] = "shipped",
    episodes: Annotated[
        int | None,
        typer.Option(metavar="N", help="End after so many; default: go on.", show_default=False),
    ] = None,
    seed: Annotated[
        int, typer.Option(metavar="SEED", help="Episodes are those of lndrl evaluate --seed SEED.")
    ] = 0,
    pace: Annotated[
        float, typer.Option(metavar="X", help="Seconds of the world in a second.")
    ] = 1.0,
    fast: Annotated[
        bool, typer.Option("--fast", help="As fast as commands come; brings --clock along.")
    ] = False,
    clock: Annotated[
        bool, typer.Option("--clock", help="Simulated time, published on /clock.")
    ] = False,
    goals: Annotated[
        bool, typer.Option("--goals/--no-goals", help="Publish goals, with their time limit.")
    ] = True,
    people: Annotated[
        Literal["spencer", "poses", "none"],
        typer.Option(help="People as SPENCER's tracks, as poses without velocities, or not."),
    ] = "spencer",
    amcl: Annotated[
        bool, typer.Option("--amcl", help="It localizes itself, and publishes /amcl_pose.")
    ] = False,
    stamped: Annotated[
        bool, typer.Option("--stamped", help="It wants commands as TwistStamped.")
    ] = False,
    robot: RobotOption = None,
    scanner: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEGREES[,upside-down]",
            help="Where the scanner is, told on /tf_static; default: as --robot, else 0,0,0.",
            show_default=False,
        ),
    ] = None,
    sweep: Annotated[
        bool, typer.Option("--sweep", help="Its scanner turns while it drives, and says so.")
    ] = False,
    delay: Annotated[float, typer.Option(metavar="S", help="Sensors are so late.")] = 0.0,
    jitter: Annotated[float, typer.Option(metavar="S", help="Deviation of that.")] = 0.0,
    loss: Annotated[float, typer.Option(metavar="SHARE", help="Of sensors' messages.")] = 0.0,
    clock_offset: Annotated[
        float, typer.Option(metavar="S", help="Sensors' clock is so far ahead.")
    ] = 0.0,
    mute: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FOR:START:S",
            help="A topic is silent, e.g. scan:10:2; can be repeated.",
            show_default=False,
        ),
    ] = None,
    command_timeout: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="It stops by itself without a command for so long; default: as --robot, else 0.5.",
            show_default=False,
        ),
    ] = None,
    zenoh: OverlayOption = None,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Listen beyond this machine, unprotected.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Episodes as JSON, a line each.")] = False,
) -> None:
    """Stand in for a ROS 2 robot: publish a world as one would, and obey cmd_vel.

    Scan, odometry, tf, map, people, start and goal over Zenoh; drive it from another terminal with
    lndrl drive, or anything else that speaks to robots. It judges episodes as lndrl evaluate does.
    With --robot it has that robot's size, brakes, scanner and topics.
    """
    from lndrl.robot.link import Address, open_link
    from lndrl.robot.shapes import rehearsed
    from lndrl.robot.stand_in import Body, Rehearsal, StandIn

    address = Address(
        check_endpoint(listen, "--listen"), dialect or "rmw", distribution or "jazzy", domain,
        zenoh, listen=True, insecure=insecure,
    )  # fmt: skip
    shape = robot_named(robot)
    if shape is not None:
        stamped = stamped or shape.topics.stamped
    if command_timeout is None:
        command_timeout = 0.5 if shape is None else shape.timeout
    rehearsal = Rehearsal(
        episodes, None if fast else pace, clock or fast, goals, people, stamped, command_timeout,
        conditions=_conditions(delay, jitter, loss, clock_offset, mute),
    )  # fmt: skip
    topics = topics_of(topic, namespace, shape)
    config = _config(policy, scenario, seed)
    mount = None if scanner is None else scanner_in(scanner)
    fastest = None
    if shape is not None:
        config, own = rehearsed(shape, config), shape.scanner.scanner()
        mount = own if mount is None else replace(mount, range_min=own.range_min)
        fastest = shape.speed.linear, shape.speed.angular
    like = f"as {policy} was trained" if shape is None else shape.description or f"as {robot}"
    say(f"robot-sim: {config.scenario.name}, {like}; loading")
    body = Body(config, mount, amcl, fastest, sweep)

    def told(record: DrivenEpisode) -> None:
        typer.echo(json_format.dumps(record.to_dict()) if json else _line(record))

    with (
        last_resort(_ENDS_WITHIN),
        stop_on_signals("the robot stops") as stop,
        open_link(address, "robot_sim") as link,
    ):
        stand_in = StandIn(link, body, rehearsal, topics)
        say(f"robot-sim: listens at {listen}, dialect {address.dialect}; waiting for a driver")
        records = stand_in.run(stop, told)
    if not json and len(records) > 1:
        typer.echo(_summary(records))
    if not json:
        place = body.config.scenario.name
        say_next("lndrl", "evaluate", policy, "--scenario", place, then="the same without a robot")
    if stop.is_set():
        raise typer.Exit(stop.exit_code)


def _config(policy: str, scenario: str | None, seed: int) -> RunConfig:
    from lndrl.evaluation import settings_for
    from lndrl.planners import planner_source

    if seed < 0:
        raise UserError(f"--seed {seed}: must be 0 or more")
    config = settings_for(planner_source(policy), scenario or "hall")
    if config.localization.kind == "perfect":
        raise UserError("--like: a filter that knows the truth is none that a robot has")
    return config.model_copy(update={"seed": seed})


def _conditions(
    delay: float, jitter: float, loss: float, clock_offset: float, mutes: list[str] | None
) -> Conditions:
    from lndrl.robot.stand_in import Conditions, Mute

    found = []
    for text in mutes or []:
        purpose, _, rest = text.partition(":")
        start, seconds = numbers_in(rest.replace(":", ","), 2, "--mute", "scan:10:2")
        if purpose not in ("scan", "odometry", "tf", "people", "people_poses", "robot_pose"):
            raise UserError(f"--mute {text}: nothing of that name; e.g. scan:10:2 or odometry:5:1")
        found.append(Mute(purpose, start, seconds))
    return Conditions(delay, jitter, loss, clock_offset, tuple(found))


def _line(record: DrivenEpisode) -> str:
    how = "walked into where it stood," if _walked_into(record) else record.outcome
    return (
        f"episode {record.episode}: {how} after {record.time:.1f} s and "
        f"{record.distance:.1f} m, position error {record.position_error:.2f} m"
    )


def _walked_into(record: DrivenEpisode) -> bool:
    return record.outcome == "collided" and record.stood


def _summary(records: list[DrivenEpisode]) -> str:
    count = len(records)
    ends = {
        each: sum(record.outcome == each for record in records)
        for each in ("arrived", "collided", "lost", "timeout")
    }
    said = ", ".join(f"{number} {outcome}" for outcome, number in ends.items() if number)
    into = sum(map(_walked_into, records))
    return f"{count} episodes: {said}" + (f"; {into} walked into where it stood" if into else "")
