"""``lndrl bench``: how fast the parts are on this machine."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from lndrl.cli.again import same_command
from lndrl.cli.signals import telling
from lndrl.errors import UserError


def bench(
    name: Annotated[
        str,
        typer.Argument(
            help="laser, crowd, amcl, world, reward, gym, policy, learner, transport, train, "
            "memory, guard, tls, or all; or gpu: all that wants one, in a few minutes"
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
            "--set", metavar="KEY=VALUE", help="world, policy, learner, train, memory: also so"
        ),
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
) -> None:
    """Measure a part of the system on this machine, beside its peers where asked."""
    import json

    from lndrl.bench import report

    if name == "gpu":
        given = {"--peers": peers, "--profile": profile, "--seconds": seconds is not None}
        given |= {"--device": bool(device), "--vs": bool(vs), "--set": bool(settings)}
        _check_alone(given)
        _measure_gpu(rehearse, minutes, out, json_output)
        return
    if rehearse or minutes is not None or out is not None:
        option = "--rehearse" if rehearse else "--out" if out is not None else "--minutes"
        raise UserError(f"{option} goes with gpu, not with {name}")
    seconds = 5.0 if seconds is None else seconds
    if not seconds > 0:
        raise UserError(f"--seconds {seconds:g}: must be above 0")
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
        _measure(names, figures, name == "all", peers, profile, seconds, device, json_output, steps)
    facts = report.machine()
    if not json_output:
        typer.echo(report.machine_line(facts))
        return
    content = figures if name == "all" else figures[name]
    typer.echo(json.dumps({**content, "machine": facts}, indent=2))


def _check_alone(given: dict[str, bool]) -> None:
    """Raise UserError where an option was ``given`` that gpu does not take."""
    if option := next((name for name, value in given.items() if value), None):
        raise UserError(
            f"{option} does not go with gpu, which takes --minutes, --out, --rehearse and --json; "
            "CUDA_VISIBLE_DEVICES chooses the card"
        )


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


def _measure(
    names: list[str],
    figures: dict[str, Any],
    everything: bool,
    peers: bool,
    profile: bool,
    seconds: float,
    device: str | None,
    quiet: bool,
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
            figures[each] = report.measure(each, seconds, on_device)
        if peers and (not everything or each in report.COMPARED):
            figures[each]["peers"] = report.measure_peers(each, seconds)
        if not quiet:
            plain = {key: value for key, value in figures[each].items() if key != "profile"}
            print_tables(report.figures_table(each, plain))
            if profile:
                print_tables(train.profile_table(figures[each]["profile"]))
