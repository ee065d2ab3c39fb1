"""Benchmarks by name, how one is timed, and the machine it ran on."""

from __future__ import annotations

import contextlib
import importlib
import os
import platform
import statistics
import sys
from collections.abc import Callable, Mapping
from importlib import metadata
from time import perf_counter
from typing import TYPE_CHECKING, Any

from rich.table import Table

from lndrl.errors import UserError
from lndrl.machine.cores import usable_cores
from lndrl.machine.processor import model
from lndrl.wording import counted

if TYPE_CHECKING:
    import torch

BENCHMARKS = {
    "laser": "ray casting and whole scans, one core",
    "crowd": "one tick of 22 pedestrians, one core",
    "amcl": "AMCL updates with fixed particle counts, one core",
    "world": "control steps of a scenario on one core, AMCL included, no policy",
    "reward": "control steps with a reward term in Python beside those without, one core",
    "gym": "control steps of 32 worlds as Gymnasium's users take them, one core, no policy",
    "policy": "policy inference on real observations, one core",
    "learner": "forward and backward of both nets",
    "ranks": "gradient steps of two ranks on a core each, beside one rank on one core",
    "weights": "half precision for actors: bytes, and what it does to the policy",
    "transport": "acknowledged uploads over zenoh, actor in another process",
    "train": "whole training, learner and actors",
    "robot": "scan to command and stale scan to stop of a drive, one core, over zenoh",
    "memory": "resident memory of actor and learner in MB, by part and in a training",
    "dashboard": "CPU of a viewer that draws 300 actors twice a second, and of an actor it watches",
    "guard": "the guard against bodies that do their worst, one core: touches, standing, time",
    "tls": "whole training over mutual TLS beside the same over plain TCP, in turns",
}
"""Each is a module ``lndrl.bench.NAME`` with ``measure(seconds) -> {key: figure}``."""
COMPARED = ("laser", "crowd", "amcl", "world", "train")
"""What other packages do too: ``lndrl.bench.peers.NAME`` has ``measure_peers(seconds)``, which
returns ``{peer: {key: figure}}`` of the same work in the same run."""
ON_DEVICES = ("policy", "learner", "train")
"""These take a ``device``: ``measure(seconds, device)``."""
ADJUSTED = ("world", "policy", "learner", "ranks", "train", "memory")
"""These can be measured under other settings than their own."""

REPETITIONS = 5
_PACKAGES = {
    "numpy": "numpy",
    "numba": "numba",
    "torch": "torch",
    "pymunk": "pymunk",
    "zenoh": "eclipse-zenoh",
    "amcl": "amcl",
    "irsim": "ir-sim",
    "irsim_x": "irsim-x",
    "navground": "navground",
    "pysocialforce": "pysocialforce",
    "pyrvo": "pyrvo",
    "range_libc": "pyrangelibc-danieldugas",
    "raycast2D": "raycast2D",
    "stable_baselines3": "stable-baselines3",
}


def measure(
    name: str, seconds: float, device: str | None = None, episodes: int | None = None
) -> dict[str, Any]:
    """Run one benchmark for about ``seconds`` of timed work and return its figures.

    ``episodes`` are for ``robot``: so many of a rehearsal beside those of ``lndrl evaluate``.
    ``device`` is cpu, cuda, cuda:N or auto; the CPU by default. Raises UserError for an unknown
    name or a device that the benchmark does not know.
    """
    if name not in BENCHMARKS:
        raise UserError(f"benchmark {name!r} is unknown; known: {', '.join(BENCHMARKS)}, all, gpu")
    if device is not None and name not in ON_DEVICES:
        raise UserError(f"--device: {name} runs on the CPU; those with: {', '.join(ON_DEVICES)}")
    given: dict[str, Any] = {} if device is None else {"device": device}
    if episodes is not None:
        given["episodes"] = episodes
    module = importlib.import_module(f"lndrl.bench.{name}")
    figures: dict[str, Any] = module.measure(seconds, **given)
    return figures


def measure_peers(name: str, seconds: float) -> dict[str, Any]:
    """The same work done by other packages, ``{peer: {key: figure}}``.

    A peer that is not installed has one entry, ``missing``: how to get it. Raises UserError for
    a benchmark without peers.
    """
    if name not in COMPARED:
        raise UserError(f"--peers: {name} has no peers; those with: {', '.join(COMPARED)}")
    # Some peers print when they are imported; --json must stand alone on standard output.
    with contextlib.redirect_stdout(sys.stderr):
        module = importlib.import_module(f"lndrl.bench.peers.{name}")
        figures: dict[str, Any] = module.measure_peers(seconds)
    return figures


def median_seconds(
    call: Callable[[], Any], seconds: float, repetitions: int = REPETITIONS
) -> float:
    """Median over ``repetitions`` of the seconds that one ``call`` takes.

    One call warms up (compilation, caches), a second one says how many calls fit into
    ``seconds / repetitions``; every repetition then times as many in a row, at least one.
    """
    call()
    started = perf_counter()
    call()
    once = max(perf_counter() - started, 1e-9)
    calls = max(1, int(seconds / repetitions / once))
    times = []
    for _ in range(repetitions):
        started = perf_counter()
        for _ in range(calls):
            call()
        times.append((perf_counter() - started) / calls)
    return statistics.median(times)


def machine() -> dict[str, Any]:
    """What the figures depend on: CPU, usable cores, versions of what does the work."""
    versions = {"python": platform.python_version()}
    for module, package in _PACKAGES.items():
        # Only what a benchmark imported worked for it.
        if module in sys.modules:
            versions[module] = metadata.version(package)
    return {
        "cpu": model(),
        "cores": usable_cores(),
        "system": f"{platform.system()} {platform.release()}",
        "load": round(os.getloadavg()[0], 2),
        "versions": versions,
    }


def device_name(device: torch.device) -> str:
    """Model of the CPU or GPU."""
    import torch

    return torch.cuda.get_device_name(device) if device.type == "cuda" else model()


def machine_line(facts: Mapping[str, Any]) -> str:
    """``machine()`` in one line."""
    versions = ", ".join(f"{name} {version}" for name, version in facts["versions"].items())
    return f"{facts['cpu']}, {counted(facts['cores'], 'core')}, load {facts['load']}; {versions}"


def figures_table(name: str, figures: Mapping[str, Any]) -> Table:
    """Figures as rows ``key  value``; nested keys are joined by a space."""
    table = Table(title=f"{name}: {BENCHMARKS[name]}", title_justify="left")
    table.add_column("figure")
    table.add_column("value", justify="right")
    for key, value in flatten(figures):
        table.add_row(key, value_text(value))
    return table


def flatten(figures: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Nested figures as pairs of keys, joined by a space, and values."""
    rows: list[tuple[str, Any]] = []
    for key, value in figures.items():
        label = f"{prefix} {key}".strip()
        rows += flatten(value, label) if isinstance(value, Mapping) else [(label, value)]
    return rows


def value_text(value: Any) -> str:
    """A figure as people read it."""
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)
