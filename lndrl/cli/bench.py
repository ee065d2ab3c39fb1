"""``lndrl bench``: how fast the parts are on this machine."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from lndrl.cli.again import arguments_given, same_command
from lndrl.cli.help import say_next
from lndrl.cli.signals import telling
from lndrl.errors import UserError


def bench(
    name: Annotated[
        str,
        typer.Argument(
            help="laser, crowd, amcl, world, reward, gym, policy, learner, ranks, weights, "
            "transport, train, memory, dashboard, guard, tls, robot, or all; gpu: all that wants "
            "one, in minutes; fleet: how many actors a learner carries"
        ),
    ],
    peers: Annotated[
        bool,
        typer.Option("--peers", help="also laser, crowd, amcl, world, train as others do them"),
    ] = False,
    profile: Annotated[
        bool, typer.Option("--profile", help="train: where the time of both sides goes, too")
    ] = False,
    json_output: Annotated[
        bool, typer.Option("--json", help="print figures as JSON instead of tables")
    ] = False,
    seconds: Annotated[
        float | None,
        typer.Option(help="timed seconds per figure, 5 unless given; more is steadier"),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            "--device", metavar="DEVICE", help="policy, learner, train: cpu, cuda, cuda:0 or auto"
        ),
    ] = None,
    vs: Annotated[
        str | None,
        typer.Option(
            "--vs",
            metavar="COMMIT",
            help="world, policy, learner, train: in turns with that build of a clone",
        ),
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, help="turns of each build with --vs")] = 3,
    steps: Annotated[
        int | None,
        typer.Option(min=1, help="guard: so many control steps instead of seconds, e.g. 1000000"),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="world, policy, learner, ranks, train, memory, fleet: also so",
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(min=1, help="robot: also so many, rehearsed beside lndrl evaluate"),
    ] = None,
    rehearse: Annotated[
        bool, typer.Option("--rehearse", help="gpu: the same script on the CPU, in small")
    ] = False,
    minutes: Annotated[
        float | None, typer.Option(help="gpu: for all of it, 8 unless given (a rehearsal 5)")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="gpu: JSON of what is known so far, at any time"),
    ] = None,
    actors: Annotated[
        str | None,
        typer.Option(metavar="N,N,...", help="fleet: synthetic actors, 1,8,64 unless given"),
    ] = None,
    update: Annotated[
        str | None,
        typer.Option(
            metavar="drain|real",
            help="fleet: drain (unless given) books what came as trained; real: the learner learns",
        ),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="fleet: one chunk of each actor every so often, not 300 steps/s"
        ),
    ] = None,
    link: Annotated[
        str | None,
        typer.Option(
            metavar="MS,LOSS",
            help="fleet: learner and actors in namespaces, so many ms of round trip between them, "
            "this share of packets lost each way, e.g. 100,0.01; needs root",
        ),
    ] = None,
    congestion: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="fleet --link: bbr (unless given), cubic or reno"),
    ] = None,
    site: Annotated[
        bool, typer.Option("--site", help="fleet: actors come through the door of a site")
    ] = False,
) -> None:
    """Measure a part of the system on this machine, beside its peers where asked."""
    import json

    from lndrl.bench import report

    if name == "gpu":
        given = {"--peers": peers, "--profile": profile, "--seconds": seconds is not None}
        given |= {"--device": bool(device), "--vs": bool(vs), "--set": bool(settings)}
        _check_alone(given, _GPU_TAKES)
        _measure_gpu(rehearse, minutes, out, json_output)
        return
    if name == "fleet":
        given = {"--peers": peers, "--profile": profile, "--device": bool(device), "--vs": bool(vs)}
        _check_alone(given, "fleet, which takes --actors, --update, --every, --link and --set")
        far = link, congestion or "bbr", site
        _measure_fleet(actors, update, every, seconds, far, settings or [], json_output)
        return
    own = {"--actors": actors, "--update": update, "--every": every, "--link": link}
    own |= {"--congestion": congestion, "--site": site or None}
    if option := next((key for key, value in own.items() if value is not None), None):
        raise UserError(f"{option} goes with fleet, not with {name}")
    if rehearse or minutes is not None or out is not None:
        option = "--rehearse" if rehearse else "--out" if out is not None else "--minutes"
        raise UserError(f"{option} goes with gpu, not with {name}")
    seconds = 5.0 if seconds is None else seconds
    if not seconds > 0:
        raise UserError(f"--seconds {seconds:g}: must be above 0")
    if episodes is not None and name != "robot":
        raise UserError(f"--episodes goes with robot, not with {name}")
    if steps is not None and name != "guard":
        raise UserError(f"--steps goes with guard, not with {name}")
    if profile and name != "train":
        raise UserError(f"--profile goes with train, not with {name}")
    if settings and name not in report.ADJUSTED:
        raise UserError(f"--set goes with {', '.join(report.ADJUSTED)}, not with {name}")
    if vs is not None:
        if profile or device or settings:
            raise UserError("--vs compares two builds on the CPU; give it alone or with --peers")
        _compare(name, vs, seconds, rounds, peers, json_output)
        return
    names = list(report.BENCHMARKS) if name == "all" else [name]
    figures: dict[str, Any] = {}

    def words() -> str:
        left = ", ".join(each for each in names if each not in figures)
        shown = "printed nothing" if json_output else f"showed {', '.join(figures) or 'nothing'}"
        return f"{shown}; not measured: {left or 'nothing'}; begin again with: {same_command()}"

    from lndrl.bench.scene import with_settings

    with telling(words), with_settings(settings or []):
        _measure(
            *(names, figures, name == "all", peers, profile, seconds, device, json_output),
            *(episodes, steps),
        )
    facts = report.machine()
    if not json_output:
        typer.echo(report.machine_line(facts))
        _say_what_follows(name, name in report.COMPARED and not peers)
        return
    content = figures if name == "all" else figures[name]
    typer.echo(json.dumps({**content, "machine": facts}, indent=2))


def _say_what_follows(name: str, alone: bool) -> None:
    """``alone``: others do the same, and were not measured."""
    if name == "all":
        say_next("lndrl", "bench", "train", "--profile", then="where a training's time goes")
    elif alone:
        say_next("lndrl", *arguments_given(), "--peers", then="beside other packages")
    else:
        say_next("lndrl", *arguments_given(), "--json", then="all digits")


_GPU_TAKES = (
    "gpu, which takes --minutes, --out, --rehearse and --json; "
    "CUDA_VISIBLE_DEVICES chooses the card"
)


def _check_alone(given: dict[str, bool], what: str) -> None:
    """Raise UserError where an option was ``given`` that ``what`` does not take."""
    if option := next((name for name, value in given.items() if value), None):
        raise UserError(f"{option} does not go with {what}")


def _measure_fleet(
    actors: str | None,
    update: str | None,
    every: float | None,
    seconds: float | None,
    far: tuple[str | None, str, bool],
    settings: list[str],
    quiet: bool,
) -> None:
    """Play synthetic actors against a learner and show a row for each number of them."""
    import json

    from lndrl.bench import report
    from lndrl.bench.fleet.plan import plan_of
    from lndrl.bench.fleet.row import measure
    from lndrl.bench.fleet.table import table
    from lndrl.bench.scene import with_settings
    from lndrl.cli.signals import say
    from lndrl.cli.tables import print_tables

    if seconds is not None and not seconds > 0:
        raise UserError(f"--seconds {seconds:g}: must be above 0")
    least = 2.0 * (seconds or 5.0)
    plan = plan_of(actors or "1,8,64", update or "drain", every, least, *far)
    rows: list[Any] = []

    def words() -> str:
        known = ", ".join(str(row["actors"]) for row in rows) or "no number of"
        return f"measured {known} actors; begin again with: {same_command()}"

    with telling(words), with_settings(settings):
        rows.extend(measure(plan, lambda line: None if quiet else say(line)))
    if quiet:
        typer.echo(json.dumps(rows, indent=2))
        return
    print_tables(table(rows, plan.update))
    typer.echo(report.machine_line(report.machine()))
    if plan.update == "drain":
        say_next("lndrl", "bench", "fleet", "--update", "real", then="while the learner learns")
    else:
        say_next("lndrl", *arguments_given(), "--json", then="all digits")


def _measure_gpu(rehearse: bool, minutes: float | None, out: Path | None, quiet: bool) -> None:
    """Measure all that wants a GPU, or rehearse that; exit code 1 where a part failed."""
    import json

    from lndrl.bench import gpu, report
    from lndrl.cli.signals import say
    from lndrl.cli.tables import print_tables

    if minutes is not None and not minutes > 0:
        raise UserError(f"--minutes {minutes:g}: must be above 0")
    plan = gpu.rehearsal() if rehearse else gpu.full_plan()
    gpu.check_device(plan)
    place = out or Path(time.strftime("bench-gpu-%Y%m%d-%H%M%S.json"))
    words = f"{place} holds what was measured; begin again with: {same_command()}"
    with telling(lambda: words):
        content = gpu.measure(plan, plan.minutes if minutes is None else minutes, place, say)
    if quiet:
        typer.echo(json.dumps(content, indent=2))
    else:
        print_tables(gpu.table(content))
        typer.echo(report.machine_line(content["machine"]))
        typer.echo(f"{place} holds all digits")
        say_next("lndrl", "train", "--device", "cuda", then="a training on it")
    if gpu.has_failed(content):
        raise typer.Exit(1)


def _compare(name: str, commit: str, seconds: float, rounds: int, peers: bool, quiet: bool) -> None:
    """Measure both builds in turns and show their ratios; then those who do the same elsewhere."""
    import json

    from lndrl.bench import report, versus
    from lndrl.cli.signals import say
    from lndrl.cli.tables import print_tables

    other = versus.prepare(commit)
    with telling(lambda: f"compared nothing; begin again with: {same_command()}"):
        figures = versus.compare(name, other, seconds, rounds, say)
        elsewhere = {"peers": report.measure_peers(name, seconds)} if peers else {}
    facts = report.machine()
    if quiet:
        content = {"vs": other.commit, "rounds": rounds, "settings": list(other.settings)}
        typer.echo(json.dumps({**figures, **elsewhere, **content, "machine": facts}, indent=2))
        return
    print_tables(versus.table(name, other, figures))
    if elsewhere:
        print_tables(report.figures_table(name, elsewhere))
    typer.echo(report.machine_line(facts))
    say_next("lndrl", *arguments_given(), "--json", then="all digits")


def _measure(
    names: list[str],
    figures: dict[str, Any],
    everything: bool,
    peers: bool,
    profile: bool,
    seconds: float,
    device: str | None,
    quiet: bool,
    episodes: int | None = None,
    steps: int | None = None,
) -> None:
    """Measure ``names`` into ``figures`` and show each as soon as it is there, unless ``quiet``."""
    from lndrl.bench import guard, report, train
    from lndrl.cli.tables import print_tables

    for each in names:
        on_device = device if not everything or each in report.ON_DEVICES else None
        if steps is not None:
            figures[each] = guard.run(steps)
        elif profile:
            figures[each] = train.measure_profile(seconds, device or "cpu")
        else:
            given = () if episodes is None else (episodes,)
            figures[each] = report.measure(each, seconds, on_device, *given)
        if peers and (not everything or each in report.COMPARED):
            figures[each]["peers"] = report.measure_peers(each, seconds)
        if not quiet:
            plain = {key: value for key, value in figures[each].items() if key != "profile"}
            print_tables(report.figures_table(each, plain))
            if profile:
                print_tables(train.profile_table(figures[each]["profile"]))
