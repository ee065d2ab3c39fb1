"""``lndrl play``: one test episode as a picture, an animation, a video or a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import same_command
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_notes, say_origins
from lndrl.cli.options import (
    GuardOption,
    GuardSettings,
    PlannerSettings,
    ScenarioName,
    ShieldOption,
    ShieldSettings,
    Temperature,
    TrustModules,
    WhichCheckpoint,
    check_picture,
    guard_config,
    of_run,
    part_settings,
    sampled,
    shield_config,
    trust,
)
from lndrl.cli.signals import telling
from lndrl.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lndrl.navigation import Navigation
    from lndrl.navigation.snapshot import WorldSnapshot

PNG_DPI = 130


@telling(lambda: f"no whole picture was written; begin again with: {same_command()}")
def play(
    planner: Annotated[
        str,
        typer.Argument(
            metavar="RUN_OR_WEIGHTS",
            help="Run folder, weights file, 'shipped', 'random', 'straight', 'dwa', 'predictive',"
            " 'careful', 'careful+map' or module:Class.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="FILE.png: the end with all paths; FILE.gif or FILE.mp4: all of it.",
            show_default=False,
        ),
    ] = None,
    rerun: Annotated[
        str | None,
        typer.Option(
            metavar="WHERE",
            help="Record it for the Rerun viewer: FILE.rrd, 'viewer' to start one here, or the "
            "address of one.",
            show_default=False,
        ),
    ] = None,
    panels: Annotated[
        bool,
        typer.Option(
            help="Below the map: pose error, reward parts and action probabilities.",
        ),
    ] = True,
    scenario: ScenarioName = None,
    seed: Annotated[int, typer.Option(metavar="SEED", help="As in lndrl evaluate.")] = 0,
    episode: Annotated[
        int, typer.Option(metavar="K", help="The episode that lndrl evaluate numbers K, from 0.")
    ] = 0,
    at: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", min=0, help="FILE.png: this moment instead of the end."),
    ] = None,
    greedy: Annotated[
        bool, typer.Option("--greedy", help="Take the likeliest action instead of sampling.")
    ] = False,
    temperature: Temperature = None,
    checkpoint: WhichCheckpoint = None,
    planner_set: PlannerSettings = None,
    shield: ShieldOption = False,
    shield_set: ShieldSettings = None,
    guard: GuardOption = False,
    guard_set: GuardSettings = None,
    trust_modules: TrustModules = None,
) -> None:
    """Draw an episode of a policy as a picture or an animation, or record it for Rerun."""
    _check(out, rerun, seed, episode)
    trust(trust_modules)
    from lndrl.evaluation import EpisodeRunner, settings_for
    from lndrl.evaluation.thoughts import with_thoughts
    from lndrl.planners import planner_source

    settings = part_settings(planner_set, "--planner-set")
    which = of_run(planner, checkpoint, [planner])
    source = planner_source(
        planner, settings, checkpoint=which, shield=shield_config(shield, shield_set),
        guard=guard_config(guard, guard_set),
    )  # fmt: skip
    source = sampled(source, temperature, greedy)
    say_origins([source], greedy)
    config = settings_for(source, scenario).model_copy(update={"seed": seed})
    say_notes(config.scenario.map_notes)
    if at is not None and (out is None or out.suffix.lower() != ".png"):
        raise UserError("--at goes with a .png; all else shows all moments")
    snapshots: list[WorldSnapshot] = []
    runner = EpisodeRunner(source, config, greedy)

    def watch(world: Navigation) -> None:
        snapshots.append(with_thoughts(world, runner.planner))

    (record,) = runner([episode], watch)
    if rerun is not None:
        _record(snapshots, rerun)
    if out is not None:
        _draw(snapshots, out, at, panels)
    names = " and ".join(str(where) for where in (out, rerun) if where is not None)
    typer.echo(
        f"{names}: {record.outcome} after {record.time:.1f} s and {record.distance:.1f} m, "
        f"position error {record.position_error:.2f} m, return {record.episode_return:.0f}"
    )
    named = (planner, "--scenario", scenario) if scenario else (planner,)
    if out is None or out.suffix.lower() != ".png":
        say_next("lndrl", "evaluate", *named, "--episodes", 200, then="how it does on average")
    else:
        film = out.with_suffix(".gif")
        numbered = ("--seed", seed, "--episode", episode)
        say_next("lndrl", "play", *named, *numbered, "--out", film, then="all of it")


def _record(snapshots: list[WorldSnapshot], where: str) -> None:
    from lndrl.view.playing.recording import save_recording

    try:
        save_recording(snapshots, where)
    except OSError as error:
        raise UserError(f"--rerun {where}: cannot be written ({error.strerror})") from None


def _draw(snapshots: list[WorldSnapshot], out: Path, at: float | None, panels: bool) -> None:
    """Draw what ``out`` is for: the moment ``at`` (s) or the end, or all moments."""
    from lndrl.view.pictures.film import FIGURE_WIDTH, save_gif
    from lndrl.view.pictures.world import world_figure
    from lndrl.view.playing.course import course_of
    from lndrl.view.playing.figure import moment_figure
    from lndrl.view.playing.video import save_mp4
    from lndrl.view.progress import progress_bar

    course = course_of(snapshots)

    def draw(k: int) -> Figure:
        if panels:
            return moment_figure(snapshots, k, course=course)
        return world_figure(snapshots[k], FIGURE_WIDTH)

    kind = out.suffix.lower()
    try:
        if kind == ".png":
            last = len(snapshots) - 1
            if at is not None:
                last = max((k for k, s in enumerate(snapshots) if s.time <= at + 1e-9), default=0)
            draw(last).savefig(out, dpi=PNG_DPI)
            return
        with progress_bar(len(snapshots), f"drawing {out.name}", "pictures") as advance:
            if kind == ".gif":
                save_gif(snapshots, out, progress=lambda _: advance(), figure=draw)
            else:
                save_mp4(draw, len(snapshots), out, progress=lambda _: advance())
    except OSError as error:
        raise UserError(f"--out {out}: cannot be written ({error.strerror})") from None


def _check(out: Path | None, rerun: str | None, seed: int, episode: int) -> None:
    if out is None and rerun is None:
        raise UserError("nothing to make; give --out FILE.png, .gif or .mp4, or --rerun FILE.rrd")
    if out is not None:
        check_picture(out, ".png", ".gif", ".mp4")
        if out.suffix.lower() == ".mp4":
            from lndrl.view.playing.video import ffmpeg

            ffmpeg()
    if rerun is not None:
        from lndrl.view.playing.recording import check_target
        from lndrl.view.playing.recording import needed as recorder

        check_target(rerun)
        recorder()
    if seed < 0:
        raise UserError(f"--seed {seed}: must be 0 or more")
    if episode < 0:
        raise UserError(f"--episode {episode}: must be 0 or more")
