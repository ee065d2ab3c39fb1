"""``lndrl bench train``: the whole system, learner and actor processes over zenoh."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from lndrl.bench import world
from lndrl.bench.scene import settings
from lndrl.bench.training import WARM_UPDATES, Rows, Training, span
from lndrl.transport.status import overhead, shares_of

_LEAST_UPDATES = 4


def measure(seconds: float, device: str = "cpu") -> dict[str, Any]:
    """``steps_per_second`` and ``learner_busy`` of ``lndrl train configs/lndrl.yaml``, 4 epochs.

    Runs ``lndrl train`` as users do, in a folder of its own, until ``12 * seconds`` of timed
    updates have passed (one minute by default). ``learner_busy`` is the share of the learner's
    time that is not waiting for data, ``overhead_learner`` and ``overhead_actor`` are the shares
    of their busy times that are neither simulation nor networks, ``actors`` how many there were
    on average, ``actor_megabytes`` the largest resident memory of one. Raises UserError when the
    run does not get going.
    """
    rows, megabytes = _run(seconds, device)
    return figures(rows) | {"actor_megabytes": megabytes}


def measure_profile(seconds: float, device: str = "cpu") -> dict[str, Any]:
    """``measure``, and under ``profile`` where the time of both sides goes.

    By activity: microseconds of one core per environment step on actors, of the wall per sample on
    the learner. ``simulate_parts`` are those of ``lndrl bench world``, with random actions.
    """
    rows, megabytes = _run(seconds, device)
    parts = world.microseconds_by_part(seconds)
    return (
        figures(rows)
        | {"actor_megabytes": megabytes}
        | {"profile": _profile(rows) | {"simulate_parts": parts}}
    )


def profile_table(profile: Mapping[str, Mapping[str, float]]) -> Table:
    """The ``profile`` of ``measure_profile`` as rows ``activity  µs  share``."""
    table = Table(title="where the time goes", title_justify="left")
    table.add_column("activity")
    table.add_column("µs", justify="right")
    table.add_column("share", justify="right")
    for side, unit in (("actor", "per environment step"), ("learner", "per sample")):
        micros = profile[side]
        table.add_row(f"[bold]{side}[/bold], {unit}", f"{sum(micros.values()):,.1f}", "")
        for name, share in shares_of(micros).items():
            table.add_row(f"  {name}", f"{micros[name]:,.1f}", f"{100 * share:.1f} %")
            if name == "simulate":
                for part, value in profile["simulate_parts"].items():
                    table.add_row(f"    {part}, alone", f"{value:,.1f}", "", style="dim")
        wasted = overhead(micros)
        table.add_row("  overhead", "", "" if wasted is None else f"{100 * wasted:.1f} %")
        table.add_section()
    return table


def _run(seconds: float, device: str) -> tuple[Rows, float]:
    """Rows of the timed updates and the one before them; the largest memory of an actor in MB."""
    megabytes = 0.0

    def done(rows: Rows) -> bool:
        nonlocal megabytes
        megabytes = max(megabytes, training.megabytes()[1])
        if len(rows) < WARM_UPDATES + _LEAST_UPDATES:
            return False
        return span(rows[WARM_UPDATES - 1 :]) >= 12.0 * seconds

    more = [part for each in settings() for part in ("--set", each)]
    with (
        tempfile.TemporaryDirectory(prefix="lndrl-bench-") as folder,
        Training("bench train", Path(folder), "tcp", ["--device", device, *more]) as training,
    ):
        rows = training.wait(done)
    return rows[WARM_UPDATES - 1 :], megabytes


def figures(rows: Rows) -> dict[str, Any]:
    """The figures of ``measure`` from rows of updates; what is timed begins with the first."""
    profile = _profile(rows)
    return {
        "steps_per_second": (rows[-1]["steps"] - rows[0]["steps"]) / span(rows),
        "learner_busy": 1.0 - shares_of(profile["learner"]).get("wait", 0.0),
        "overhead_actor": overhead(profile["actor"]),
        "overhead_learner": overhead(profile["learner"]),
        "updates": len(rows) - 1,
        "actors": sum(row["time"]["actors"] for row in rows[1:]) / (len(rows) - 1),
        "lag_mean": sum(row["lag"]["mean"] for row in rows) / len(rows),
    }


def _profile(rows: Rows) -> dict[str, dict[str, float]]:
    """Microseconds by activity between the first and the last row, per step and per sample."""
    before, after = rows[0]["time"]["spent"], rows[-1]["time"]["spent"]

    def per(side: str, count: int) -> dict[str, float]:
        return {
            name: 1e6 * (total - before[side].get(name, 0.0)) / max(count, 1)
            for name, total in after[side].items()
        }

    return {
        "actor": per("actors", after["actor_steps"] - before["actor_steps"]),
        "learner": per("learner", rows[-1]["steps"] - rows[0]["steps"]),
    }
