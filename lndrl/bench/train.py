"""``lndrl bench train``: the whole system, learner and actor processes over zenoh."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from lndrl.bench import world
from lndrl.config import REPOSITORY_CONFIGS
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import free_port, this_program
from lndrl.transport.status import overhead, shares_of
from lndrl.view.metrics import read_metrics

_STARTUP = 300.0  # s within which the first update must come
_WARM_UPDATES = 2  # updates that are not counted: compilation, first episodes
_LEAST_UPDATES = 4
_EPOCHS = 4  # whatever lndrl.yaml finds best, the figure stays comparable


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
    return _figures(rows) | {"actor_megabytes": megabytes}


def measure_profile(seconds: float, device: str = "cpu") -> dict[str, Any]:
    """``measure``, and under ``profile`` where the time of both sides goes.

    By activity: microseconds of one core per environment step on actors, of the wall per sample on
    the learner. ``simulate_parts`` are those of ``lndrl bench world``, with random actions.
    """
    rows, megabytes = _run(seconds, device)
    parts = world.microseconds_by_part(seconds)
    return (
        _figures(rows)
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


def _run(seconds: float, device: str) -> tuple[list[dict[str, Any]], float]:
    """Rows of the timed updates and the one before them; the largest memory of an actor in MB."""
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as folder:
        process = _start(Path(folder), device)
        try:
            megabytes = _watch(process, Path(folder) / "runs/bench/metrics.jsonl", 12.0 * seconds)
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60.0)
        rows = _rows(Path(folder) / "runs/bench/metrics.jsonl")[_WARM_UPDATES - 1 :]
    return rows, megabytes


def _figures(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    first, last = rows[0], rows[-1]
    profile = _profile(rows)
    return {
        "steps_per_second": (last["steps"] - first["steps"])
        / (last["time"]["unix"] - first["time"]["unix"]),
        "learner_busy": 1.0 - shares_of(profile["learner"]).get("wait", 0.0),
        "overhead_actor": overhead(profile["actor"]),
        "overhead_learner": overhead(profile["learner"]),
        "updates": len(rows) - 1,
        "actors": sum(row["time"]["actors"] for row in rows[1:]) / (len(rows) - 1),
        "lag_mean": sum(row["lag"]["mean"] for row in rows) / len(rows),
    }


def _profile(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
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


def _start(folder: Path, device: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "lndrl", "train", str(REPOSITORY_CONFIGS / "lndrl.yaml")]
    command += ["--run", "bench", "--no-dashboard", "--listen", f"tcp/127.0.0.1:{free_port()}"]
    command += ["--set", f"ppo.epochs={_EPOCHS}", "--device", device]
    with (folder / "log").open("wb") as log:
        return subprocess.Popen(command, cwd=folder, env=this_program(), stdout=log, stderr=log)


def _watch(process: subprocess.Popen[bytes], metrics: Path, seconds: float) -> float:
    """Wait for enough updates; returns the largest memory of an actor in MB."""
    began = time.monotonic()
    megabytes = 0.0
    while True:
        time.sleep(0.5)
        megabytes = max([megabytes, *(_resident(pid) for pid in _children(process.pid))])
        rows = _rows(metrics)
        if process.poll() is not None:
            raise UserError("bench train: the run ended early; try lndrl train by itself")
        if len(rows) < _WARM_UPDATES and time.monotonic() - began > _STARTUP:
            raise UserError(f"bench train: no update within {_STARTUP:.0f} s on this machine")
        if len(rows) >= _WARM_UPDATES + _LEAST_UPDATES:
            timed = rows[-1]["time"]["unix"] - rows[_WARM_UPDATES - 1]["time"]["unix"]
            if timed >= seconds:
                return megabytes


def _rows(metrics: Path) -> list[dict[str, Any]]:
    try:
        return read_metrics(metrics)
    except UserError:  # not yet written
        return []


def _children(pid: int) -> list[int]:
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    except OSError:
        return []
    return [int(child) for child in text.split()]


def _resident(pid: int) -> float:
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return float(line.split()[1]) / 1024.0
    except OSError:
        return 0.0
    return 0.0
