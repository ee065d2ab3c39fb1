"""Chapters about results of the bench: the table beside the paper's, places, pairs and goals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lndrl.evaluation.benchmark.results.repeated import ENDS
from lndrl.view.palette import OUTCOME_WORD
from lndrl.view.pictures.learning.curves import value_at
from lndrl.view.pictures.learning.many_curves import PANELS, Curves, many_figure
from lndrl.view.pictures.rates import FIELDS, rates_figure, shares_of
from lndrl.view.report.embedded import chart
from lndrl.view.report.parts import (
    OUTCOME_TONE,
    Facts,
    Folded,
    Gallery,
    Part,
    Picture,
    Section,
    Table,
    Text,
    Tile,
    Tiles,
    Tone,
)
from lndrl.view.results import (
    VERDICT,
    captions,
    goal_rows,
    metric_rows,
    paired_rows,
    repeated_rows,
    scenario_rows,
    training_rows,
)
from lndrl.view.text import percent

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import Recorded
    from lndrl.evaluation.benchmark.results import Results

_PUBLISHED = "  published"
_PAIRED = [f"{what} ({how})" for how in ("arrived", "lost") for what in ("points", "p", "pairs")]
_REPEATED = [cell for end in ENDS for cell in (end, f"chance ({end})")]
_VERDICT_TONE: dict[str, Tone] = {
    VERDICT[True]: "good",
    VERDICT[False]: "bad",
    VERDICT[None]: "quiet",
}


def results_sections(results: Results) -> list[Section]:
    """Everything that ``lndrl results`` says, chapter by chapter."""
    words = captions(results)
    head, rows = metric_rows(results, "\n")
    published = frozenset(i for i, row in enumerate(rows) if row[0] == _PUBLISHED)
    named = [(_name(rows, i), *row[1:]) for i, row in enumerate(rows)]
    charts = [_rates(results, outcome) for outcome in FIELDS]
    parts: list[Part | Folded] = [
        _tiles(results),
        Gallery(charts, 300),
        Table(words["metrics"], head, named, quiet=published),
    ]
    parts += [Text(note) for note in results.notes()]
    sections = [
        Section("table", "The table beside the paper's", parts),
        Section("scenarios", "Scenarios", [Table(words["scenarios"], *scenario_rows(results))]),
    ]
    head, rows = paired_rows(results, "\n")
    if rows:
        table = Table(words["pairs"], ("against", "episodes", *_PAIRED), rows)
        sections.append(Section("pairs", "Paired differences", [table]))
    _, rows = repeated_rows(results, "\n")
    if rows:
        table = Table(words["repeated"], ("trained alike", *_REPEATED), rows)
        sections.append(Section("repeated", "What chance is worth in training", [table]))
    head, rows = goal_rows(results)
    table = Table(words["goals"], head, rows, words=frozenset({0, 1, 2}), tones=_VERDICT_TONE)
    return [*sections, Section("goals", "Goals", [table]), *_trainings(results)]


def _trainings(results: Results) -> list[Section]:
    """How the rows learned, as curves and as a table; nothing where that is not on record."""
    head, rows = training_rows(results)
    if not rows:
        return []
    curves = [Curves(names[0], t.rows, t.curve) for t, names in results.trainings]
    ends = "; ".join(f"{run.name} {_ended(run)}" for run in curves)
    alt = f"Chart of arrived, collided and lost over steps; the last of each: {ends}."
    picture = chart("learning", many_figure(curves), alt, "As they learned.")
    table = Table(captions(results)["trainings"], head, rows, words=frozenset({0, 6}))
    return [Section("trainings", "How the rows were trained", [picture, table])]


def _ended(run: Curves) -> str:
    shares = (value_at(run.rows[-1], f"episodes.{name}") for name in PANELS)
    return ", ".join(percent(share) for share in shares)


def identity_section(results: Results) -> Section:
    """What the figures stand for: bench, seed, version, and who drove."""
    identity = results.identity
    facts = [
        ("folder", results.folder),
        ("version of the bench", str(identity.bench_version)),
        ("seed", str(identity.seed)),
        ("episodes of", identity.family),
        ("tested by", f"lndrl {identity.program_version}"),
    ]
    methods = [
        (name, *(what.get(key, "–") for key in ("planner", "actions", "localization", "identity")))
        for name, what in identity.methods.items()
    ]
    scenarios = [
        (name, digest, ", ".join(identity.changes.get(name, ())) or "–")
        for name, digest in identity.scenarios.items()
    ]
    return Section(
        "provenance",
        "What was tested",
        [
            Facts(facts),
            Table(
                "Methods as they were tested.",
                ("method", "planner", "actions", "localization", "identity"),
                methods,
                words=frozenset(range(5)),
            ),
            Folded(
                "Scenarios and their hashes",
                [
                    Table(
                        "Scenarios as they were tested.",
                        ("scenario", "hash", "set there"),
                        scenarios,
                        words=frozenset(range(3)),
                    )
                ],
            ),
        ],
    )


def worst_table(rows: Sequence[Recorded], method: str) -> Table:
    """The worst episodes as they are recorded, for those that cannot be driven again too."""
    return Table(
        f"The worst episodes of {method} as they are recorded.",
        ("episode", "ended", "time (s)", "distance (m)", "mean position error (m)"),
        [
            (
                f"{row.scenario}, {row.episode}",
                OUTCOME_WORD[row.record.outcome],
                f"{row.record.time:.1f}",
                f"{row.record.distance:.1f}",
                f"{row.record.position_error:.2f}",
            )
            for row in rows
        ],
        words=frozenset({0, 1}),
    )


def _tiles(results: Results) -> Tiles:
    row = results.reference
    metrics, hazard = row.metrics, row.hazard
    tiles = []
    for outcome, (name, _) in FIELDS.items():
        rate = getattr(metrics, name)
        low, high = (100 * end for end in rate.interval)
        note = f"{low:.1f}–{high:.1f} % of {rate.episodes:,}"
        tiles.append(
            Tile(f"{row.method} {outcome}", percent(rate.value), note, OUTCOME_TONE[outcome])
        )
    low, high = hazard.interval
    note = f"{low:.2f}–{high:.2f} per 1,000 control steps"
    tiles.append(Tile(f"{row.method}: hazard", f"{hazard.value:.2f}", note, "quiet"))
    return Tiles(tiles)


def _rates(results: Results, outcome: str) -> Picture:
    """How often each method ended so, beside what the paper has."""
    shares = shares_of(results, outcome)
    word = OUTCOME_WORD[outcome]
    told = (
        f"{share.method} {percent(share.value)}"
        + (f" (paper {percent(share.published)})" if share.published is not None else "")
        for share in shares
    )
    alt = f"Chart of the share of episodes that ended {word}, by method: {'; '.join(told)}."
    return chart(
        f"rates-{outcome}", rates_figure(outcome, shares), alt, f"Episodes that ended {word}"
    )


def _name(rows: Sequence[Sequence[str]], i: int) -> str:
    """What heads row ``i``: beside a method's own row stands what the paper has of it."""
    return f"{rows[i - 1][0]}, published" if rows[i][0] == _PUBLISHED else rows[i][0]
