"""``lndrl play``: one test episode as a picture or an animation."""

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
    from lndrl.navigation import Navigation
    from lndrl.navigation.snapshot import WorldSnapshot


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
        Path, typer.Option(metavar="FILE", help="FILE.png: the end with all paths; FILE.gif: all.")
    ],
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
    """Draw an episode of a policy as a picture or an animation."""
    _check(out, seed, episode)
    trust(trust_modules)
    from lndrl.evaluation import EpisodeRunner, settings_for
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
    animated = out.suffix.lower() == ".gif"
    if animated and at is not None:
        raise UserError("--at goes with a .png; a .gif shows all moments")
    snapshots: list[WorldSnapshot] = []

    def watch(world: Navigation) -> None:
        if not animated:
            if at is not None and snapshots and world.world.time > at + 1e-9:
                return
            snapshots.clear()
        snapshots.append(world.snapshot())

    (record,) = EpisodeRunner(source, config, greedy)([episode], watch)
    try:
        _draw(snapshots, out, animated)
    except OSError as error:
        raise UserError(f"--out {out}: cannot be written ({error.strerror})") from None
    typer.echo(
        f"{out}: {record.outcome} after {record.time:.1f} s and {record.distance:.1f} m, "
        f"position error {record.position_error:.2f} m, return {record.episode_return:.0f}"
    )
    named = (planner, "--scenario", scenario) if scenario else (planner,)
    if animated:
        say_next("lndrl", "evaluate", *named, "--episodes", 200, then="how it does on average")
    else:
        film = out.with_suffix(".gif")
        numbered = ("--seed", seed, "--episode", episode)
        say_next("lndrl", "play", *named, *numbered, "--out", film, then="all of it")


def _draw(snapshots: list[WorldSnapshot], out: Path, animated: bool) -> None:
    from lndrl.view.pictures.film import save_gif
    from lndrl.view.pictures.world import save_png
    from lndrl.view.progress import progress_bar

    if not animated:
        save_png(snapshots[-1], out)
        return
    with progress_bar(len(snapshots), f"drawing {out.name}", "pictures") as advance:
        save_gif(snapshots, out, progress=lambda _: advance())


def _check(out: Path, seed: int, episode: int) -> None:
    check_picture(out, ".png", ".gif")
    if seed < 0:
        raise UserError(f"--seed {seed}: must be 0 or more")
    if episode < 0:
        raise UserError(f"--episode {episode}: must be 0 or more")
