"""The page about a run: what its folder says, and how its policy drives."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from learner.intake.ledger import LEDGER_FILE, newest_totals
from learner.run.overview import DAMAGED, EMPTY, FINISHED, STOPPED, TRAINING, Overview, overview
from lndrl.cli.evaluation.driving import arrivals_bar
from lndrl.cli.notes import say_notes, say_origins
from lndrl.cli.reporting.machine import machine_section, made
from lndrl.config import DEFAULTS, RunConfig, differences, keys, load_config
from lndrl.curve import read_curve
from lndrl.errors import UserError
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.machine.cores import usable_cores
from lndrl.view.report.parts import (
    Command,
    Facts,
    Folded,
    Listing,
    Page,
    Part,
    Section,
    Text,
    Tile,
    Tiles,
    Tone,
)
from lndrl.view.text import MISSING, duration, number, percent, printable
from lndrl.wilson import wilson_interval
from lndrl.wording import counted

if TYPE_CHECKING:
    from lndrl.evaluation.filmed import Filmed
    from lndrl.planners import PlannerSource

_TONES: dict[str, Tone] = {FINISHED: "good", DAMAGED: "bad", TRAINING: "quiet"}
_EVENTS = 40
_SHOWN = 4  # trajectories
_LONGEST = 200  # characters of a value


@dataclass(frozen=True)
class Asked:
    """How many episodes to drive (0: none) and to show of the worst, and of which policy."""

    episodes: int
    worst: int
    seed: int
    checkpoint: str | None
    workers: int | None


def run_page(folder: Path, asked: Asked) -> Page:
    """Everything about the run in ``folder``.

    Raises UserError for a run that has no update yet, a damaged one, and for a checkpoint that is
    not there.
    """
    run = overview(folder)
    if run.state == DAMAGED:
        raise UserError(run.why)
    rows, validated = read_metrics(folder / "metrics.jsonl"), read_curve(folder / "metrics.jsonl")
    config = load_config(folder / "config.yaml")
    driven = _driven(folder, config, asked)
    from lndrl.view.report.training import curves_section, validation_section

    validation = validation_section(validated)
    sections = [
        _standing(run, rows[-1], folder),
        curves_section(rows, validated),
        *([validation] if validation else []),
        *driven,
        _configuration(config),
        _books(folder),
        machine_section(_where_from(folder)),
    ]
    total = f" of {run.total:,}" if run.total else ""
    lead = (
        f"A training in {run.scenario}: {run.steps:,}{total} steps, last written "
        + time.strftime("%Y-%m-%d at %H:%M %Z.", time.localtime(run.unix))
    )
    title = f"Run {printable(run.name)}"
    return Page(title, lead, sections, made(), run.state, _TONES.get(run.state, "lost"))


def _standing(run: Overview, row: Mapping[str, Any], folder: Path) -> Section:
    from lndrl.view.report.training import outcome_tiles

    shares = {name: getattr(run, name) for name in ("arrived", "collided", "lost", "timeout")}
    window = row.get("episodes", {}).get("window")
    note = f"newest {counted(window, 'training episode')}" if window else "in training"
    tiles = [*outcome_tiles(shares, note).tiles]
    if run.validated is not None and run.validated_of:
        low, high = wilson_interval(round(run.validated * run.validated_of), run.validated_of)
        words = f"{100 * low:.0f}–{100 * high:.0f} % of {run.validated_of} episodes"
        tiles.append(Tile("best validated", percent(run.validated), words, "good"))
    time_of = row.get("time", {})
    facts = [
        ("steps", f"{run.steps:,}" + (f" of {run.total:,}" if run.total else "")),
        ("updates", f"{row.get('update', 0):,}"),
        ("episodes", f"{run.episodes:,}"),
        ("mean return", number(run.mean_return)),
        ("scenario", run.scenario),
        ("teacher", run.teacher or "none"),
        ("newest checkpoint", run.checkpoint or "none"),
        ("steps per second, of late", number(time_of.get("steps_per_second"))),
        *_summary(folder),
    ]
    parts = [Tiles(tiles), Facts(facts), *_next(run, folder), *_events(folder)]
    return Section("standing", "How it stands", parts)


def _summary(folder: Path) -> list[tuple[str, str]]:
    """What the summary of a run that has ended says beyond its metrics."""
    summary = _read(folder / "summary.json")
    found = []
    if isinstance(seconds := summary.get("seconds"), int | float):
        found.append(("trained for", duration(float(seconds))))
    if summary.get("early"):
        found.append(("finished early", str(summary["early"])))
    return found


def _next(run: Overview, folder: Path) -> list[Command]:
    if run.state == TRAINING:
        return [Command("lndrl dashboard", "Watch it:")]
    if run.state == STOPPED:
        return [Command(f"lndrl train --run {run.name} --resume", "Go on with it:")]
    if run.state == EMPTY:
        return []
    return [Command(f"lndrl evaluate {folder} --episodes 200", "Measure it:")]


def _configuration(config: RunConfig) -> Section:
    from lndrl.view.report.training import configuration_section

    base = DEFAULTS["configuration"]
    known = keys()
    differs = [
        (key, _short(here), _short(there), known[key].description if key in known else "")
        for key, (there, here) in differences(load_config(base), config).items()
    ]
    return configuration_section(differs, f"{base}.yaml", config.to_yaml(), config.content_hash())


def _books(folder: Path) -> Section:
    from lndrl.view.report.training import books_section

    try:
        newest = newest_totals(folder / LEDGER_FILE)
    except OSError as error:
        return books_section(None, f"{LEDGER_FILE} cannot be read ({error.strerror}).")
    if newest is None:
        return books_section(None, f"{LEDGER_FILE} notes no checkpoint yet.")
    totals, step = newest
    return books_section(totals, f"From {LEDGER_FILE}, at the checkpoint of step {step:,}.")


def _where_from(folder: Path) -> list[tuple[str, str]]:
    identity, holder = _read(folder / "run.json"), _read(folder / "lock")
    found = [
        ("run", str(identity.get("run_id", MISSING))),
        ("begun by", f"lndrl {identity.get('version', MISSING)}"),
    ]
    if isinstance(host := holder.get("host"), str):
        found.append(("trained last on", printable(host)))
    return found


def _events(folder: Path) -> list[Part | Folded]:
    """The newest lines of the event log."""
    try:
        lines = (folder / "events.log").read_text("utf-8", "replace").splitlines()
    except OSError:
        return []
    words = f"The newest {counted(min(len(lines), _EVENTS), 'event')} of {len(lines):,}"
    shown = "\n".join(printable(line) for line in lines[-_EVENTS:])
    return [Folded(words, [Listing(shown)])] if lines else []


def _driven(folder: Path, config: RunConfig, asked: Asked) -> list[Section]:
    """The chapters of episodes that the run's policy drives for the page."""
    if not asked.episodes:
        return []
    from lndrl.planners import planner_source

    try:
        source = planner_source(str(folder), checkpoint=asked.checkpoint)
    except UserError as error:
        if asked.checkpoint is not None:
            raise
        say_notes([f"no episode is driven: {error}"])
        return [Section("episodes", "Episodes driven", [Text(f"None: {error}.")])]
    say_origins([source])
    say_notes(config.scenario.map_notes)
    world = (source.config or config).model_copy(update={"seed": asked.seed})
    filmed = _film(source, world, asked)
    return _chapters(source, world, filmed, asked)


def _film(source: PlannerSource, config: RunConfig, asked: Asked) -> Filmed:
    from lndrl.evaluation.filmed import film

    workers = usable_cores() if asked.workers is None else asked.workers
    with arrivals_bar(asked.episodes, f"driving for the report of {source.label}") as note:
        return film(
            source,
            config,
            asked.episodes,
            first=_SHOWN,
            worst=asked.worst,
            workers=workers,
            progress=note,
        )


def _chapters(
    source: PlannerSource, config: RunConfig, filmed: Filmed, asked: Asked
) -> list[Section]:
    from lndrl.evaluation import result_of
    from lndrl.view.pictures.worst import Panel
    from lndrl.view.progress import progress_bar
    from lndrl.view.report import episodes

    result = result_of(source, config, False, filmed.records)
    origin = f" ({source.origin})" if source.origin else ""
    said = (
        f"{counted(len(filmed.records), 'validation episode')} of seed {asked.seed} in "
        f"{config.scenario.name}, driven by the policy of this run{origin}, in the world that it "
        f"was trained in; {config.localization.kind} localization. lndrl evaluate drives the same."
    )
    failed = sum(record.outcome != "arrived" for record in filmed.records)
    words = (
        f"{counted(failed, 'episode')} of {len(filmed.records)} did not arrive; shown are the "
        f"worst {len(filmed.worst)}"
    )
    with progress_bar(5, "drawing", "chapters") as advance:
        sections = []
        sections.append(episodes.outcomes_section(result, said))
        advance(1, "trajectories")
        sections.append(episodes.trajectories_section(filmed.first))
        advance(1, "why it gets lost")
        sections += _why_lost(source, config, filmed)
        advance(1, "activations")
        sections.append(episodes.activations_section(filmed.look, filmed.blind))
        advance(1, "failures")
        if asked.worst:
            panels = [Panel(drive) for drive in filmed.worst]
            sections.append(episodes.gallery_section(panels, words))
        advance(1)
    return sections


def _why_lost(source: PlannerSource, config: RunConfig, filmed: Filmed) -> list[Section]:
    if not filmed.traces:
        return []  # it is told the truth
    from lndrl.evaluation.lost import Limits, LostReport
    from lndrl.view.report.episodes import lost_section

    task = config.task
    report = LostReport(
        planner=source.label,
        world="the world that it was trained in",
        seed=config.seed,
        scenarios=(config.scenario.name,),
        limits=Limits(task.lost_distance, task.lost_angle, config.localization.heard_delay),
        traces=filmed.traces,
    )
    return [lost_section(report, config.scenario)]


def _read(path: Path) -> dict[str, Any]:
    """A small JSON file of the run; empty where it is not there or not whole."""
    try:
        found = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _short(value: object) -> str:
    text = MISSING if value is None else str(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
