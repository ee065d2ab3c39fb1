"""Chapters about how a run was trained: curves, validation, its books and its configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lndrl.view.palette import BLUE, ORANGE, OUTCOME, OUTCOME_WORD, PINK, SKY, SLATE, VERMILLION
from lndrl.view.pictures.learning.curves import (
    Row,
    column,
    outcomes_figure,
    series_figure,
    value_at,
)
from lndrl.view.report.embedded import chart
from lndrl.view.report.parts import (
    OUTCOME_TONE,
    Facts,
    Folded,
    Gallery,
    Listing,
    Part,
    Picture,
    Section,
    Table,
    Text,
    Tile,
    Tiles,
)
from lndrl.view.text import MISSING, number, percent
from lndrl.wilson import wilson_interval
from lndrl.wording import counted

_SERIES = (
    ("mean return", "episodes.mean_return", BLUE),
    ("mean position error (m)", "episodes.position_error", PINK),
    ("entropy (nat)", "ppo.entropy", ORANGE),
    ("KL per update", "ppo.kl", VERMILLION),
    ("explained variance", "ppo.explained_variance", SKY),
    ("lag of samples (versions)", "lag.mean", SLATE),
    ("steps per second", "time.steps_per_second", BLUE),
)
_ROWS = 12
"""Of the table beside the curves."""


def outcome_tiles(shares: Mapping[str, float | None], note: str) -> Tiles:
    """A tile for each way to end; ``note`` says of which episodes."""
    return Tiles(
        [
            Tile(OUTCOME_WORD[name], percent(shares.get(name)), note, OUTCOME_TONE[name])
            for name in OUTCOME
        ]
    )


def curves_section(rows: Sequence[Row], validated: Sequence[Row]) -> Section:
    """The learning curves, each as a chart of its own, and some of their rows as a table."""
    last = rows[-1]
    shares = {name: value_at(last, f"episodes.{name}") for name in OUTCOME}
    ends = ", ".join(f"{OUTCOME_WORD[name]} {percent(share)}" for name, share in shares.items())
    steps = value_at(last, "steps")
    until = f"up to step {steps:,.0f}" if steps is not None else f"over {len(rows)} updates"
    large = chart(
        "outcomes",
        outcomes_figure(rows, validated),
        f"Line chart of how training episodes end, {until}. At the end: {ends}.",
        "How training episodes end: faint as measured over the newest episodes, strong smoothed."
        + (" Dots with bars: validated arrivals, 95 % Wilson intervals." if validated else ""),
    )
    small = [_series(rows, *each, i) for i, each in enumerate(_SERIES)]
    parts: list[Part | Folded] = [
        large,
        Gallery([picture for picture in small if picture is not None], 290),
        Folded("The curves as a table", [_curve_table(rows)]),
    ]
    return Section("curves", "Learning curves", parts)


def _series(rows: Sequence[Row], name: str, key: str, colour: str, place: int) -> Picture | None:
    values = [value for value in column(rows, key).tolist() if value == value]
    if not values:
        return None
    alt = (
        f"Line chart of {name} over training: from {number(values[0])} to {number(values[-1])}, "
        f"lowest {number(min(values))}, highest {number(max(values))}."
    )
    figure = series_figure(rows, key, name, colour)
    return chart(f"series{place}", figure, alt, f"{name}: {number(values[-1])} at the end")


def _curve_table(rows: Sequence[Row]) -> Table:
    count = min(len(rows), _ROWS)
    chosen = [rows[round(i * (len(rows) - 1) / max(count - 1, 1))] for i in range(count)]
    table = [
        (
            _whole(value_at(row, "steps")),
            _whole(value_at(row, "episodes.count")),
            *(percent(value_at(row, f"episodes.{name}")) for name in OUTCOME),
            *(number(value_at(row, key)) for key in _KEYS.values()),
        )
        for row in chosen
    ]
    head = ("steps", "episodes", *(OUTCOME_WORD[name] for name in OUTCOME), *_KEYS)
    caption = f"{counted(len(chosen), 'row')} of {len(rows):,}, evenly spread."
    return Table(caption, head, table)


_KEYS = {"return": "episodes.mean_return", "entropy": "ppo.entropy", "KL": "ppo.kl"}


def validation_section(validated: Sequence[Row]) -> Section | None:
    """Every validated version with its intervals; None where nothing was validated."""
    if not validated:
        return None
    rows = [
        (
            f"{row['steps']:,}",
            *(_interval(row["sampled"], name) for name in ("arrived", "collided", "lost")),
            _interval(row["greedy"], "arrived"),
        )
        for row in validated
    ]
    best = max(validated, key=lambda row: row["sampled"]["arrived"] / row["sampled"]["episodes"])
    share = best["sampled"]["arrived"] / best["sampled"]["episodes"]
    words = (
        f"{counted(len(validated), 'version')} validated over "
        f"{counted(validated[-1]['sampled']['episodes'], 'episode')} each; the most arrivals, "
        f"{percent(share)}, at step {best['steps']:,}."
    )
    table = Table(
        "Shares with 95 % Wilson intervals; sampled actions, in the last column the likeliest.",
        ("steps", "arrived", "collided", "lost", "arrived, greedy"),
        rows,
    )
    folded: Part | Folded = table
    if len(rows) > _ROWS:
        folded = Folded(f"All {len(rows)} validated versions", [table])
    return Section("validation", "Validation", [Text(words), folded])


def books_section(totals: Mapping[str, Any] | None, source: str) -> Section:
    """What became of every acknowledged sample; ``totals`` as a ledger has them, None for none.

    ``source`` is a sentence: where they are from, or why there are none.
    """
    title = "What became of every sample"
    if totals is None:
        return Section("ledger", title, [Text(source)])
    kinds = [("trained on", totals["trained"])]
    kinds += [(f"dropped: {rule}", tally) for rule, tally in totals["dropped"].items()]
    kinds += [("waiting", totals["waiting"])]
    accepted, spent = totals["accepted"]["samples"], sum(t["samples"] for _, t in kinds)
    rows = [
        (name, f"{tally['samples']:,}", f"{tally['chunks']:,}")
        for name, tally in [("accepted", totals["accepted"]), *kinds]
    ]
    words = (
        f"Accepted are {accepted:,} samples, and as many were trained on, dropped by a named rule "
        "or wait: all are accounted for."
        if spent == accepted
        else f"Accepted are {accepted:,} samples, but accounted for are {spent:,}."
    )
    head = ("what became of them", "samples", "chunks")
    return Section("ledger", title, [Text(words), Table(source, head, rows)])


def configuration_section(
    differs: Sequence[tuple[str, str, str, str]], base: str, whole: str, digest: str
) -> Section:
    """Keys that differ from the configuration ``base`` (key, here, there, meaning), and all."""
    parts: list[Part | Folded] = []
    if differs:
        parts.append(
            Table(
                f"{counted(len(differs), 'key')} in which it differs from {base}.",
                ("key", "this run", base, "what it is"),
                differs,
                words=frozenset({0, 1, 2, 3}),
            )
        )
    else:
        parts.append(Text(f"It says what {base} says."))
    parts.append(Facts([("hash of the configuration", digest)]))
    parts.append(Folded("The whole configuration", [Listing(whole)]))
    return Section("configuration", "Configuration", parts)


def _interval(counts: Mapping[str, int], name: str) -> str:
    low, high = wilson_interval(counts[name], counts["episodes"])
    return f"{percent(counts[name] / counts['episodes'])}\n{100 * low:.1f}–{100 * high:.1f}"


def _whole(value: float | None) -> str:
    return MISSING if value is None else f"{value:,.0f}"
