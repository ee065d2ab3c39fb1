"""``lndrl bench train``: the whole system, learner and actor processes over zenoh."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from lndrl.config import REPOSITORY_CONFIGS
from lndrl.errors import UserError
from lndrl.view.metrics import read_metrics

_STARTUP = 300.0  # s within which the first update must come
_WARM_UPDATES = 2  # updates that are not counted: compilation, first episodes
_LEAST_UPDATES = 4
_EPOCHS = 4  # whatever lndrl.yaml finds best, the figure stays comparable


def measure(seconds: float) -> dict[str, Any]:
    """``steps_per_second`` and ``learner_busy`` of ``lndrl train configs/lndrl.yaml``, 4 epochs.

    Runs ``lndrl train`` as users do, in a folder of its own, until ``12 * seconds`` of timed
    updates have passed (one minute by default). ``learner_busy`` is the share of the learner's
    time that is not waiting for data, ``actor_megabytes`` the largest resident memory of an
    actor process. Raises UserError when the run does not get going.
    """
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as folder:
        process = _start(Path(folder))
        try:
            megabytes = _watch(process, Path(folder) / "runs/bench/metrics.jsonl", 12.0 * seconds)
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60.0)
        rows = _rows(Path(folder) / "runs/bench/metrics.jsonl")[_WARM_UPDATES - 1 :]
    first, last = rows[0], rows[-1]
    elapsed = last["time"]["unix"] - first["time"]["unix"]
    waits = [row["time"]["share_wait"] for row in rows[1:]]
    return {
        "steps_per_second": (last["steps"] - first["steps"]) / elapsed,
        "learner_busy": 1.0 - sum(waits) / len(waits),
        "updates": len(rows) - 1,
        "actor_megabytes": megabytes,
        "lag_mean": sum(row["lag"]["mean"] for row in rows) / len(rows),
    }


def _start(folder: Path) -> subprocess.Popen[bytes]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "lndrl", "train", str(REPOSITORY_CONFIGS / "lndrl.yaml")]
    command += ["--run", "bench", "--no-dashboard", "--listen", f"tcp/127.0.0.1:{port}"]
    command += ["--set", f"ppo.epochs={_EPOCHS}"]
    with (folder / "log").open("wb") as log:
        return subprocess.Popen(command, cwd=folder, stdout=log, stderr=log)


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
