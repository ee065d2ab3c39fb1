"""``lndrl localization``: how far off the filter is, how often lost, how soon back."""

from __future__ import annotations

import json as json_format
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import arguments_given, same_command
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_notes
from lndrl.cli.options import TrustModules, trust
from lndrl.cli.signals import telling
from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores

if TYPE_CHECKING:
    from lndrl.config import LocalizationConfig
    from lndrl.evaluation.localization import LogOutcome, LogPlan, LogReport, Outcome, Plan, Report


def localization(
    scenarios: Annotated[
        str,
        typer.Option(metavar="S,S", help="Names or YAML files, comma between; or 'all'."),
    ] = "all",
    logs: Annotated[
        str | None,
        typer.Option(
            metavar="FILE,FILE",
            help="Laser logs of real robots (CARMEN, .gz or not) instead of scenarios.",
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Drives per scenario and crowd (20); of the filter per log (5)."
        ),
    ] = None,
    pedestrians: Annotated[
        str, typer.Option(metavar="N,N", help="Crowds: how many pedestrians.")
    ] = "0,5,20",
    settings: Annotated[
        str,
        typer.Option(metavar="NAME,FILE", help="Presets or YAML files of localization keys."),
    ] = "paper,best",
    updates: Annotated[
        int, typer.Option(metavar="U", help="Updates per drive, ten a second.")
    ] = 600,
    workers: Annotated[
        int | None,
        typer.Option(metavar="W", help="Processes; default: one per core; 0: none but this."),
    ] = None,
    trust_modules: TrustModules = None,
    json: Annotated[bool, typer.Option("--json", help="Figures as JSON.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.md", help="Write tables there, between its marks, and a .png."),
    ] = None,
) -> None:
    """Measure the filter on recorded drives: errors, lost rate, recovery.

    Every drive is recorded once and replayed under every setting, so settings are compared on
    the same data. With --logs the same on recordings of real robots.
    """
    trust(trust_modules)
    from lndrl.evaluation.localization import check_document, report_tables

    if workers is not None and workers < 0:
        raise UserError(f"--workers {workers}: must be 0 (in this process) or more")
    count = usable_cores() if workers is None else workers
    if logs is not None:
        _on_logs(_log_plan(logs, seeds, settings), count, out, json)
        return
    if out is not None:
        check_document(out)
    plan = _plan(scenarios, 20 if seeds is None else seeds, pedestrians, settings, updates)
    say_notes(note for scenario in plan.scenarios for note in scenario.map_notes)
    report = _measure(plan, count)
    if out is not None:
        _write(report, out)
    if json:
        from lndrl.bench.report import machine

        typer.echo(json_format.dumps({"machine": machine(), **report.to_dict()}, indent=2))
        return
    from lndrl.cli.tables import print_tables

    print_tables(*report_tables(report))
    place = plan.scenarios[0].name
    say_next("lndrl", "lost", "dwa", "--scenario", place, then="what a planner makes of it")


def _plan(scenarios: str, seeds: int, pedestrians: str, settings: str, updates: int) -> Plan:
    from lndrl.evaluation.localization import Plan, scenarios_named

    _check_seeds(seeds)
    counts = []
    for text in _split(pedestrians, "--pedestrians"):
        if not text.isdecimal():
            raise UserError(f"--pedestrians {pedestrians}: write counts like 0,5,20")
        counts.append(int(text))
    plan = Plan(
        scenarios=tuple(scenarios_named(_split(scenarios, "--scenarios"))),
        pedestrians=tuple(dict.fromkeys(counts)),
        settings=_settings(settings),
        seeds=seeds,
        updates=updates,
    )
    plan.check()
    return plan


def _check_seeds(seeds: int) -> None:
    if seeds < 1:
        raise UserError(f"--seeds {seeds}: must be 1 or more")


def _settings(settings: str) -> dict[str, LocalizationConfig]:
    from lndrl.evaluation.localization import label_of, load_settings

    chosen: dict[str, LocalizationConfig] = {}
    for name in _split(settings, "--settings"):
        label = label_of(name)
        if label in chosen:
            raise UserError(f"--settings {settings}: {label} is named twice")
        chosen[label] = load_settings(name)
    return chosen


def _split(text: str, option: str) -> list[str]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not parts:
        raise UserError(f"{option} {text!r}: name one or more, with commas between")
    return parts


def _measure(plan: Plan, workers: int) -> Report:
    from lndrl.evaluation.localization import measure_localization
    from lndrl.view.progress import progress_bar

    names = ", ".join(scenario.name for scenario in plan.scenarios)
    lost = dict.fromkeys(plan.settings, 0)
    total = len(plan.tasks()) * len(plan.settings)
    ended = 0

    def words() -> str:
        return (
            f"{ended} of {total} replays have ended and are not kept; "
            f"begin again with: {same_command()}"
        )

    with telling(words), progress_bar(total, f"localization on {names}", "replays") as advance:

        def note(outcome: Outcome) -> None:
            nonlocal ended
            ended += 1
            lost[outcome.setting] += outcome.lost
            advance(1, "lost: " + ", ".join(f"{label} {n}" for label, n in lost.items()))

        return measure_localization(plan, workers, note)


def _log_plan(logs: str, seeds: int | None, settings: str) -> LogPlan:
    from lndrl.evaluation.localization import LogPlan

    _check_seeds(5 if seeds is None else seeds)
    plan = LogPlan(
        logs=tuple(Path(name) for name in _split(logs, "--logs")),
        settings=_settings(settings),
        seeds=5 if seeds is None else seeds,
    )
    plan.check()
    return plan


def _on_logs(plan: LogPlan, workers: int, out: Path | None, json: bool) -> None:
    from lndrl.bench.report import machine, machine_line
    from lndrl.evaluation.localization import (
        LOGS_BEGIN,
        LOGS_END,
        check_document,
        log_markdown,
        log_table,
        write_document,
    )
    from lndrl.version import VERSION

    if out is not None:
        check_document(out, LOGS_BEGIN, LOGS_END)
    report = _measure_logs(plan, workers)
    if out is not None:
        command = "lndrl " + shlex.join(arguments_given())
        facts = f"lndrl {VERSION}, {machine_line(machine())}"
        write_document(out, log_markdown(report, command, facts), LOGS_BEGIN, LOGS_END)
        typer.echo(f"wrote {out}", err=True)
    if json:
        typer.echo(json_format.dumps({"machine": machine(), **report.to_dict()}, indent=2))
        return
    from lndrl.cli.tables import print_tables

    print_tables(log_table(report))


def _measure_logs(plan: LogPlan, workers: int) -> LogReport:
    from lndrl.evaluation.localization import HEARD, measure_logs
    from lndrl.view.progress import progress_bar

    total = len(plan.logs) * plan.seeds * len(plan.settings) * len(HEARD)
    lost = dict.fromkeys(plan.settings, 0)
    ended = 0

    def words() -> str:
        return (
            f"{ended} of {total} replays have ended and are not kept; "
            f"begin again with: {same_command()}"
        )

    with telling(words), progress_bar(total, "localization on logs", "replays") as advance:

        def note(outcome: LogOutcome) -> None:
            nonlocal ended
            ended += 1
            lost[outcome.setting] += outcome.lost
            advance(1, "lost: " + ", ".join(f"{label} {n}" for label, n in lost.items()))

        return measure_logs(plan, workers, note)


def _write(report: Report, out: Path) -> None:
    from lndrl.bench.report import machine, machine_line
    from lndrl.evaluation.localization import report_markdown, write_document
    from lndrl.version import VERSION
    from lndrl.view.pictures.localization import save_localization

    picture = out.with_suffix(".png")
    command = "lndrl " + shlex.join(arguments_given())
    facts = f"lndrl {VERSION}, {machine_line(machine())}"
    save_localization(report, picture)
    write_document(out, report_markdown(report, command, facts, picture.name))
    typer.echo(f"wrote {out} and {picture}", err=True)
