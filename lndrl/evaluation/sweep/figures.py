"""What a sweep found: figures of every run, means over seeds, differences paired by seed.

Seeds are few, so every mean comes with its deviation, and a difference counts only where the
t interval of the pairs leaves 0 out.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.evaluation.estimate import Estimate
from lndrl.evaluation.sweep.folder import SweepFolder
from lndrl.evaluation.sweep.spec import Sweep
from lndrl.version import VERSION

LAST = 1 / 3
"""Share of a run's steps, at its end, that figures of the end are taken over."""

WINDOW = 200
"""Episodes behind a point of the arrival curve."""

EPISODE_FIGURES = {
    "arrived": "arrived",
    "collided": "collided",
    "lost": "lost",
    "return": "mean_return",
}
UPDATE_FIGURES = {"kl": "kl", "entropy": "entropy", "explained_variance": "explained_variance"}
TEST_FIGURES = {
    "test_arrived": "arrival",
    "test_collided": "collision",
    "test_lost": "lost",
}
FIGURES = (*EPISODE_FIGURES, "area", *UPDATE_FIGURES, "steps_per_second", *TEST_FIGURES)
"""Names of a run's figures: rates and mean return over the last third of its steps; ``area``, the
mean of the arrival curve over all steps; means of the updates' KL, entropy (nat) and explained
variance over the last third; steps/s; rates of the final policy's test episodes."""

Row = Mapping[str, Any]
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RunFigures:
    """One finished run; figures that it has not are None. ``episodes`` are those of the end."""

    variant: str
    seed: int
    steps: int
    episodes: int
    values: dict[str, float | None]
    curve_steps: list[int]
    curve: list[float]


@dataclass(frozen=True)
class VariantFigures:
    """One variant over its finished seeds; ``differences`` to the base, seed by seed."""

    name: str
    settings: tuple[str, ...]
    why: str
    seeds: tuple[int, ...]
    diverged: tuple[int, ...]
    estimates: dict[str, Estimate]
    differences: dict[str, Estimate]

    def to_dict(self) -> dict[str, Any]:
        """Plain types for JSON."""
        return {
            "name": self.name,
            "set": list(self.settings),
            "why": self.why,
            "seeds": list(self.seeds),
            "diverged": list(self.diverged),
            "figures": {name: each.to_dict() for name, each in self.estimates.items()},
            "differences": {
                name: {**each.to_dict(), "clear": each.clear}
                for name, each in self.differences.items()
            },
        }


@dataclass(frozen=True)
class SweepFigures:
    """Everything that is finished; ``variants`` in the file's order, the base first."""

    sweep: Sweep
    variants: tuple[VariantFigures, ...]
    runs: tuple[RunFigures, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain types for JSON."""
        spec = self.sweep.spec
        return {
            "program_version": VERSION,
            "sweep": self.sweep.name,
            "steps": spec.steps,
            "seeds": spec.seeds,
            "set": spec.set,
            "episodes": spec.episodes,
            "serial": spec.serial,
            "last_share_of_steps": LAST,
            "variants": [variant.to_dict() for variant in self.variants],
            "runs": [asdict(run) for run in self.runs],
        }


def sweep_figures(folder: SweepFolder) -> SweepFigures:
    """Figures of all finished runs in ``folder``; raises UserError for unreadable records."""
    sweep = folder.sweep
    runs: list[RunFigures] = []
    diverged: list[tuple[str, int]] = []
    for run in sweep.runs():
        state = folder.state(run)
        if state == "diverged":
            diverged.append((run.variant.name, run.seed))
        if state != "finished":
            continue
        result = folder.evaluation(run)
        tests = {
            name: getattr(result.metrics, key).value if result else None
            for name, key in TEST_FIGURES.items()
        }
        runs.append(run_figures(run.variant.name, run.seed, folder.rows(run), tests))
    return SweepFigures(sweep, compare(sweep, runs, diverged), tuple(runs))


def run_figures(
    variant: str, seed: int, rows: Sequence[Row], tests: Mapping[str, float | None]
) -> RunFigures:
    """Figures of one run from its metrics and the rates of its test episodes."""
    steps = np.array([row["steps"] for row in rows], np.float64)
    counts = np.array([row["episodes"]["count"] for row in rows], np.float64)
    first = steps[-1] * (1.0 - LAST)
    before = float(np.interp(first, steps, counts, left=0.0))
    episodes = float(counts[-1]) - before
    values: dict[str, float | None] = {}
    for name, key in EPISODE_FIGURES.items():
        so_far = totals(rows, key)
        gained = float(so_far[-1] - np.interp(first, steps, so_far, left=0.0))
        values[name] = gained / episodes if episodes > 0 else None
    curve = arrival_curve(rows)
    values["area"] = float(np.average(curve, weights=np.diff(steps, prepend=0.0)))
    for name, key in UPDATE_FIGURES.items():
        late = [row["ppo"].get(key) for row in rows if row["steps"] > first]
        known = [value for value in late if value is not None and math.isfinite(value)]
        values[name] = statistics.fmean(known) if known else None
    elapsed = rows[-1]["time"]["elapsed"]
    values["steps_per_second"] = float(steps[-1]) / elapsed if elapsed > 0 else None
    values |= tests
    return RunFigures(
        variant, seed, int(steps[-1]), round(episodes), values, steps.astype(int).tolist(),
        curve.tolist(),
    )  # fmt: skip


def totals(rows: Sequence[Row], key: str) -> Floats:
    """Sum of ``key`` over all episodes up to each row (n,), from means over its newest episodes.

    A row's mean spans the ``window`` newest of ``count`` episodes: what came before those is
    known from earlier rows, interpolated where the window begins between two. So a figure over
    many episodes counts each once, also across a resume, which begins a new window.
    """
    counts, sums = [0.0], [0.0]
    result = []
    for row in rows:
        count, window = float(row["episodes"]["count"]), float(row["episodes"]["window"])
        mean = row["episodes"][key]
        if count > counts[-1] and mean is not None:
            # Between two rows, or behind the last: with more new episodes than a window holds,
            # those that it leaves out are taken to be like the others.
            missed = max(0.0, count - window - counts[-1])
            sums.append(
                float(np.interp(count - window, counts, sums)) + (window + missed) * float(mean)
            )
            counts.append(count)
        result.append(sums[-1])
    return np.array(result)


def arrival_curve(rows: Sequence[Row]) -> Floats:
    """Share of arrivals among the ``WINDOW`` newest episodes at each row (n,); 0 before any."""
    counts = np.array([row["episodes"]["count"] for row in rows], np.float64)
    so_far = totals(rows, "arrived")
    first = np.maximum(counts - WINDOW, 0.0)
    known = np.concatenate([[0.0], counts]), np.concatenate([[0.0], so_far])
    curve = (so_far - np.interp(first, *known)) / np.maximum(counts - first, 1.0)
    return np.clip(curve, 0.0, 1.0)


def compare(
    sweep: Sweep, runs: Sequence[RunFigures], diverged: Sequence[tuple[str, int]] = ()
) -> tuple[VariantFigures, ...]:
    """Every variant over its seeds and, seed by seed, against the first variant, the base."""
    by_variant = {
        variant.name: {run.seed: run for run in runs if run.variant == variant.name}
        for variant in sweep.variants
    }
    base = by_variant[sweep.variants[0].name]
    result = []
    for i, variant in enumerate(sweep.variants):
        own = by_variant[variant.name]
        estimates = {name: Estimate.of(_values(own, name).values()) for name in FIGURES}
        differences = {}
        for name in FIGURES if i else ():
            here, there = _values(own, name), _values(base, name)
            pairs = [here[seed] - there[seed] for seed in here if seed in there]
            differences[name] = Estimate.of(pairs)
        result.append(
            VariantFigures(
                variant.name,
                variant.settings,
                variant.why,
                tuple(own),
                tuple(seed for name, seed in diverged if name == variant.name),
                estimates,
                differences,
            )
        )
    return tuple(result)


def _values(runs: Mapping[int, RunFigures], name: str) -> dict[int, float]:
    values = {seed: run.values.get(name) for seed, run in runs.items()}
    return {seed: value for seed, value in values.items() if value is not None}
