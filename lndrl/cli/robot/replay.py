"""``lndrl replay``: filter and policy over a recorded bag."""

from __future__ import annotations

import csv as csv_format
import json as json_format
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from lndrl.cli.again import arguments_given, same_command
from lndrl.cli.help import say_next
from lndrl.cli.options import GuardSettings, TrustModules, WhichCheckpoint, check_picture, trust
from lndrl.cli.robot.arguments import (
    FilterOption,
    GuardSwitch,
    NamespaceOption,
    RobotOption,
    TopicOption,
    drive_guard,
    numbers_in,
    robot_named,
    scanner_in,
    topics_of,
)
from lndrl.cli.signals import telling
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.robot.bags import Replay


@telling(lambda: f"nothing was written; begin again with: {same_command()}")
def replay(
    bag: Annotated[
        Path, typer.Argument(metavar="BAG", help="FILE.mcap, FILE.db3 or the folder of a bag.")
    ],
    policy: Annotated[
        str, typer.Option("--policy", metavar="POLICY", help="As for lndrl drive.")
    ] = "shipped",
    localization: Annotated[
        Literal["own", "robot"], typer.Option(help="Our particle filter, or /amcl_pose.")
    ] = "own",
    filter_: FilterOption = "robot",
    robot: RobotOption = None,
    guard: GuardSwitch = True,
    guard_set: GuardSettings = None,
    pose: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEGREES",
            help="Where it begins; else /initialpose or /amcl_pose.",
            show_default=False,
        ),
    ] = None,
    goal: Annotated[
        str | None,
        typer.Option(metavar="X,Y", help="Else from /goal_pose.", show_default=False),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE.yaml", help="Else from /map.", show_default=False),
    ] = None,
    scanner: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEGREES[,upside-down]", help="Else from /tf_static.", show_default=False
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC",
            help="Poses to compare with; else /amcl_pose or /lndrl/pose.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="A picture.", show_default=False)
    ] = None,
    csv: Annotated[
        Path | None,
        typer.Option(metavar="FILE.csv", help="A row for each scan.", show_default=False),
    ] = None,
    namespace: NamespaceOption = "",
    topic: TopicOption = None,
    greedy: Annotated[bool, typer.Option("--greedy", help="The likeliest actions.")] = False,
    seed: Annotated[int, typer.Option(metavar="SEED", min=0)] = 0,
    checkpoint: WhichCheckpoint = None,
    trust_modules: TrustModules = None,
    json: Annotated[bool, typer.Option("--json", help="The figures as JSON.")] = False,
) -> None:
    """Run filter and policy over a recorded bag, and say where the belief went.

    Nothing moves: what the policy would have asked for is held against what was recorded.
    """
    from lndrl.robot.driving import Limits
    from lndrl.robot.driving.assembly import DriveOptions
    from lndrl.robot.fitting import fitted_limits

    if out is not None:
        check_picture(out, ".png")
    if csv is not None and (csv.suffix != ".csv" or not csv.parent.is_dir()):
        raise UserError(f"--csv {csv}: must end in .csv, in a folder that exists")
    x_y_yaw = numbers_in(pose, 3, "--pose", "1.0,2.0,90") if pose is not None else None
    shape = robot_named(robot)
    options = DriveOptions(
        topics=topics_of(topic, namespace, shape),
        localization=localization,
        preset=filter_,
        pose=None if x_y_yaw is None else (x_y_yaw[0], x_y_yaw[1], math.radians(x_y_yaw[2])),
        goal=None if goal is None else numbers_in(goal, 2, "--goal", "4.0,1.5"),  # type: ignore[arg-type]
        map_file=map_file,
        robot=shape,
        scanner=None if scanner is None else scanner_in(scanner),
        guard=drive_guard(guard, guard_set, shape),
        limits=fitted_limits(Limits(), shape),
        greedy=greedy,
        seed=seed,
    )
    trust(trust_modules)
    result = _replay(bag, policy, checkpoint, options, reference)
    heard = f"filter {filter_}" if localization == "own" else "the robot's own poses"
    title = f"{bag.name}: {policy}, {heard}, {'guard' if guard else 'no guard'}"
    _show(result, title, out, csv, json)


def _replay(
    bag: Path, policy: str, checkpoint: str | None, options: object, reference: str | None
) -> Replay:
    from lndrl.cli.sources import planner_sources
    from lndrl.evaluation import settings_for
    from lndrl.policy.acting import act_on_one_thread
    from lndrl.robot.bags import Bag
    from lndrl.robot.bags import replay as play
    from lndrl.robot.driving.assembly import DriveOptions, drive_config, make_driver, make_pilot
    from lndrl.robot.shapes import planned_for
    from lndrl.view.progress import StatusLine

    assert isinstance(options, DriveOptions)
    with Bag(bag, options.topics, reference) as opened, StatusLine() as line:
        line.update(f"loading {policy}")
        (source,) = planner_sources([policy], {}, checkpoint, None, None, options.greedy)
        config = settings_for(source)
        if options.robot is not None and source.weights is None:
            config = planned_for(options.robot, config)
        config = drive_config(config, options)
        if source.weights is not None:
            act_on_one_thread(config)
        pilot = make_pilot(source, config, options)
        return play(
            opened,
            lambda send: make_driver(pilot, options, send),
            lambda seconds: line.update(f"{bag.name}: {seconds:.0f} of {opened.seconds:.0f} s"),
        )


def _show(result: Replay, title: str, out: Path | None, csv: Path | None, json: bool) -> None:
    from lndrl.cli.tables import print_tables
    from lndrl.view.robots.replay import replay_table, save_replay

    if csv is not None:
        try:
            with csv.open("w", newline="", encoding="utf-8") as file:
                rows = [each.to_dict() for each in result.moments]
                writer = csv_format.DictWriter(file, list(rows[0]) if rows else ["time"])
                writer.writeheader()
                writer.writerows(rows)
        except OSError as error:
            raise UserError(f"--csv {csv}: cannot be written ({error.strerror})") from None
    if out is not None:
        try:
            save_replay(result, title, out)
        except OSError as error:
            raise UserError(f"--out {out}: cannot be written ({error.strerror})") from None
    if json:
        typer.echo(json_format.dumps({**result.summary(), "words": result.words}, indent=2))
        return
    print_tables(replay_table(title, result.summary()))
    for words in result.words.values():
        typer.echo(words)
    if out is None:
        say_next("lndrl", *arguments_given(), "--out", "replay.png", then="as a picture")
    else:
        say_next("lndrl", "drive", "--help", then="a robot itself")
