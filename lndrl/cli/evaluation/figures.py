"""``lndrl figures``: pictures of the bench's episodes, driven again as the bench drives them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import same_command
from lndrl.cli.evaluation.behaviour import behaviour
from lndrl.cli.evaluation.bench.benchmark import RESULTS
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_origins
from lndrl.cli.options import BenchName, TrustModules, check_picture, names_in, trust
from lndrl.cli.signals import telling
from lndrl.errors import UserError

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import BenchmarkSpec, Identity, Recorded, ResultsFolder
    from lndrl.evaluation.benchmark.spec import Contender
    from lndrl.view.pictures.worst import Panel
    from lndrl.view.progress import Advance

figures = typer.Typer(
    add_completion=False,
    help="Draw trajectories, a network's first layer, the worst episodes of a result, or where two"
    " methods behave otherwise.",
)
figures.command("behaviour")(behaviour)

Out = Annotated[
    Path | None, typer.Option(metavar="FILE.png", help="Default: named by what is drawn.")
]
Episode = Annotated[
    int, typer.Option(metavar="K", help="The episode that lndrl benchmark numbers K, from 0.")
]
_MOST = 50


@figures.command("trajectories")
@telling(lambda: f"no picture was written; begin again with: {same_command()}")
def trajectories(
    methods: Annotated[
        str,
        typer.Option(
            metavar="M,...", help="Methods of the bench, run folders, weights or module:Class."
        ),
    ] = "dwa,lndrl",
    scenario: Annotated[
        str, typer.Option(metavar="S,...", help="Scenarios of the bench, a column each.")
    ] = "sparse",
    episode: Episode = 0,
    out: Out = None,
    spec: BenchName = None,
    trust_modules: TrustModules = None,
) -> None:
    """Draw one episode as several methods drive it: paths, position and angle error."""
    _check(episode, out)
    trust(trust_modules)
    from lndrl.evaluation.benchmark import Replay, choose, contenders_named

    bench = _bench(spec)
    places = choose(bench.scenarios, names_in(scenario), "scenario")
    asked = names_in(methods) or choose(list(bench.methods), [], "method")
    found = contenders_named(bench, asked)
    say_origins(contender.source for contender in found)
    drives = []
    with _progress(len(places) * len(found), "trajectories") as advance:
        for place in places:
            for contender in found:
                drives += Replay(contender, place, bench.seed, bench.changes_in(place)).drive(
                    [episode]
                )
                advance(1, f"{contender.name} on {drives[-1].scenario}: {drives[-1].reason}")
    from lndrl.view.pictures.trajectories import save_trajectories

    names = "-".join(dict.fromkeys(drive.scenario for drive in drives))
    file = out or Path(f"trajectories-{names}-{episode}.png")
    _save(file, lambda: save_trajectories(drives, file))
    for drive in drives:
        typer.echo(f"{drive.method} on {drive.scenario}, episode {episode}: {drive.reason}")
    typer.echo(str(file))
    if len(asked) > 1:
        say_next("lndrl", "figures", "behaviour", *asked[:2], "--scenario", places[0])


@figures.command("activations")
@telling(lambda: f"no picture was written; begin again with: {same_command()}")
def activations(
    method: Annotated[
        str, typer.Option(metavar="M", help="Method of the bench, run folder or weights file.")
    ] = "lndrl",
    scenario: Annotated[
        str, typer.Option(metavar="S", help="A scenario of the bench.")
    ] = "irregular",
    episode: Episode = 0,
    step: Annotated[
        int | None, typer.Option(metavar="T", help="After T control steps; default: halfway.")
    ] = None,
    out: Out = None,
    spec: BenchName = None,
    trust_modules: TrustModules = None,
) -> None:
    """Draw what the first laser layer of a network answers, beside scene and scan."""
    _check(episode, out)
    trust(trust_modules)
    if step is not None and step < 0:
        raise UserError(f"--step {step}: must be 0 or more")
    from lndrl.evaluation.benchmark import Replay, choose, contender_named
    from lndrl.evaluation.benchmark.moments import moment_of, need_network

    bench = _bench(spec)
    (place,) = choose(bench.scenarios, [scenario], "scenario")
    contender = contender_named(bench, method)
    need_network(contender)
    say_origins([contender.source])
    with _progress(1, "activations") as advance:
        moment = moment_of(
            Replay(contender, place, bench.seed, bench.changes_in(place)), episode, step
        )
        advance(1)
    from lndrl.view.pictures.activations import Activations, save_activations

    name, snapshot = contender.name, moment.snapshot
    title = f"{name} on {snapshot.scenario}, episode {episode}, {snapshot.time:.1f} s"
    file = out or Path(f"activations-{name}-{snapshot.scenario}-{episode}-{moment.step}.png")
    shown = Activations(snapshot, moment.scans, moment.layer.values, moment.layer.beams)
    _save(file, lambda: save_activations(shown, file, title))
    typer.echo(f"{title}: step {moment.step} of {len(moment.drive.time) - 1}")
    typer.echo(str(file))
    one = ("--methods", method, "--scenario", scenario, "--episode", episode)
    say_next("lndrl", "figures", "trajectories", *one, then="all of that episode")


@figures.command("worst")
@telling(lambda: f"no picture was written; begin again with: {same_command()}")
def worst(
    name: Annotated[
        str, typer.Option(metavar="NAME", help="The result results/NAME of lndrl benchmark.")
    ] = "benchmark",
    method: Annotated[
        str, typer.Option(metavar="M", help="A method that was tested there.")
    ] = "lndrl",
    scenario: Annotated[
        list[str] | None,
        typer.Option(metavar="S", help="May be given several times; default: all tested."),
    ] = None,
    count: Annotated[int, typer.Option(metavar="N", help="Episodes, at most 50.")] = 10,
    out: Out = None,
    trust_modules: TrustModules = None,
) -> None:
    """Draw the worst episodes of a result, with the reason each ended.

    Lost before collided before out of time before arrived; then the larger mean position error,
    then the longer time.
    """
    _check(0, out)
    trust(trust_modules)
    if not 1 <= count <= _MOST:
        raise UserError(f"--count {count}: must be 1 to {_MOST}")
    from lndrl.evaluation.benchmark import ResultsFolder, choose, contender_tested, worst_episodes

    folder = ResultsFolder(RESULTS / name)
    contender, identity = contender_tested(folder, method)
    wanted = None if scenario is None else names_in(",".join(scenario))
    places = choose(list(identity.scenarios), wanted, "scenario")
    rows = worst_episodes(folder, contender.name, places, count)
    panels = _redrive(folder, identity, contender, rows)
    from lndrl.view.pictures.worst import save_worst

    file = out or folder.path / f"worst-{contender.name}.png"
    title = f"{contender.name}: the {len(panels)} worst of {folder.path}"
    _save(file, lambda: save_worst(panels, file, title))
    for panel in panels:
        again = f" ({panel.difference})" if panel.difference else ""
        drive = panel.drive
        typer.echo(f"{drive.scenario}, episode {drive.episode}: {drive.reason}{again}")
    typer.echo(str(file))
    say_next("lndrl", "lost", method, then="why it gets lost")


def _redrive(
    folder: ResultsFolder, identity: Identity, contender: Contender, rows: list[Recorded]
) -> list[Panel]:
    """A panel for each of ``rows``, in their order, driven scenario by scenario."""
    from lndrl.evaluation.benchmark import drive_again
    from lndrl.view.pictures.worst import Panel

    with _progress(len(rows), "worst") as advance:
        found = drive_again(
            folder, identity, contender, rows, lambda drive: advance(1, drive.reason)
        )
    return [Panel(drive, otherwise) for drive, otherwise in found]


def _bench(spec: str | None) -> BenchmarkSpec:
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.benchmark import load_benchmark

    return load_benchmark(find("bench", spec or DEFAULTS["bench"]))


def _check(episode: int, out: Path | None) -> None:
    if episode < 0:
        raise UserError(f"--episode {episode}: must be 0 or more")
    if out is not None:
        check_picture(out)


def _progress(total: int, title: str) -> AbstractContextManager[Advance]:
    from lndrl.view.progress import progress_bar

    return progress_bar(total, f"driving for {title}", "episodes")


def _save(file: Path, draw: Callable[[], None]) -> None:
    try:
        draw()
    except OSError as error:
        raise UserError(f"{file}: cannot be written ({error.strerror})") from None
