"""Two builds measured in turns, so that what else the machine does meets both."""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rich.table import Table

from lndrl.bench.versus import builds
from lndrl.bench.versus.builds import Other
from lndrl.errors import UserError

FIGURES = {
    "world": ("steps_per_second hybrid", "steps_per_second corridor"),
    "policy": ("samples_per_second",),
    "learner": ("samples_per_second",),
    "train": ("steps_per_second",),
}
"""What is compared of which benchmark; more is better."""

_WARM = 0.05  # s per figure of the runs that only compile
_LEAVING = 30.0  # s


def compare(
    name: str, other: Other, seconds: float, rounds: int, say: Callable[[str], object]
) -> dict[str, Any]:
    """Figures of both builds and their ratios, from ``rounds`` rounds of ``seconds`` per figure.

    ``{figure: {own, other, ratio, ratio_least, ratio_most}}``: medians over the rounds, and the
    median, the least and the most of the rounds' own ratios. ``say`` hears how far it is. Raises
    UserError for a benchmark that is not compared and for a build that fails.
    """
    if name not in FIGURES:
        raise UserError(f"--vs compares {', '.join(FIGURES)}, not {name}")
    both = {"own": (builds.ROOT, other.settings), "other": (other.folder, ())}
    found: dict[str, dict[str, list[float]]] = {
        figure: {"own": [], "other": []} for figure in FIGURES[name]
    }
    for side, (folder, settings) in both.items():
        say(f"compiling what {_called(side, other)} needs")
        _measured("world" if name == "train" else name, folder, settings, _WARM)
    for round_ in range(rounds):
        sides = list(both) if round_ % 2 else list(both)[::-1]
        for side in sides:
            say(f"round {round_ + 1} of {rounds}: {_called(side, other)}")
            figures = _measured(name, *both[side], seconds)
            for figure, values in found.items():
                values[side].append(_value(figures, figure))
    return {figure: _ratio(values) for figure, values in found.items()}


def table(name: str, other: Other, figures: Mapping[str, Mapping[str, float]]) -> Table:
    """``compare``'s result as rows."""
    made = Table(title=f"{name}: this program beside {other.commit}", title_justify="left")
    made.add_column("figure")
    for column in ("this", other.commit, "ratio", "least", "most"):
        made.add_column(column, justify="right")
    for figure, row in figures.items():
        ratios = (f"{row[key]:.2f}" for key in ("ratio", "ratio_least", "ratio_most"))
        made.add_row(figure, f"{row['own']:,.0f}", f"{row['other']:,.0f}", *ratios)
    return made


def _ratio(values: Mapping[str, Sequence[float]]) -> dict[str, float]:
    ratios = [own / other for own, other in zip(values["own"], values["other"], strict=True)]
    return {
        "own": statistics.median(values["own"]),
        "other": statistics.median(values["other"]),
        "ratio": statistics.median(ratios),
        "ratio_least": min(ratios),
        "ratio_most": max(ratios),
    }


def _measured(name: str, folder: Path, settings: Sequence[str], seconds: float) -> dict[str, Any]:
    """What the build in ``folder`` says of itself."""
    command = [sys.executable, "-m", "lndrl", "bench", name, "--json", "--seconds", f"{seconds:g}"]
    command += [part for each in settings for part in ("--set", each)]
    environment = os.environ | {"PYTHONPATH": str(folder), "PYTHONSAFEPATH": "1"}
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as empty:
        process = subprocess.Popen(
            command, cwd=empty, env=environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8",
            start_new_session=True,
        )  # fmt: skip
        try:
            out, err = process.communicate()
        finally:
            _end(process)
    if process.returncode:
        last = (err.strip().splitlines() or ["nothing said"])[-1]
        raise UserError(f"lndrl bench {name} of {folder.name} failed: {last}")
    figures: dict[str, Any] = json.loads(out)
    return figures


def _end(process: subprocess.Popen[str]) -> None:
    """Ask it to end, then end it with whatever it has started."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_LEAVING)
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _value(figures: Any, figure: str) -> float:
    for key in figure.split():
        figures = figures[key]
    return float(figures)


def _called(side: str, other: Other) -> str:
    return "this program" if side == "own" else other.commit
