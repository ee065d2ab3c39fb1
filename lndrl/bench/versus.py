"""``lndrl bench NAME --vs COMMIT``: this program beside an older one of its own, in turns.

The commit is taken out of the repository that this program runs from, into a cache folder, and
measured by its own ``lndrl bench`` under the same interpreter and packages. The two take turns, so
that what else the machine does meets both; every round gives one ratio.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rich.table import Table

from lndrl.caches import user_cache
from lndrl.config import REPOSITORY_CONFIGS
from lndrl.errors import UserError

FIGURES = {
    "world": ("steps_per_second hybrid", "steps_per_second corridor"),
    "policy": ("samples_per_second",),
    "learner": ("samples_per_second",),
    "train": ("steps_per_second",),
}
"""What is compared of which benchmark; more is better."""

_ROOT = Path(__file__).resolve().parents[2]
_WARM = 0.05  # s per figure of the runs that only compile
_FIRST_WORLD = "benchmark-v1.yaml"
_LEAVING = 30.0  # s


@dataclass(frozen=True)
class Other:
    """Another build: its commit, where its files are, what this one is told to be like it."""

    commit: str
    folder: Path
    settings: tuple[str, ...]


def prepare(commit: str) -> Other:
    """Take ``commit`` out of this program's repository, or find what was taken before.

    Raises UserError where there is no repository, no such commit, or no ``lndrl bench`` in it.
    """
    whole = _git("rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}").decode().strip()
    if not whole:
        raise UserError(f"--vs {commit}: not a commit of {_ROOT}; git log there shows those")
    folder = Path(user_cache("builds")) / whole[:12]
    if not folder.is_dir():
        archive = _git("archive", "--format=tar", whole)
        with tempfile.TemporaryDirectory(dir=_made(folder.parent)) as made:
            packed = Path(made) / "build.tar"
            packed.write_bytes(archive)
            with tarfile.open(packed) as tar:
                tar.extractall(Path(made) / "build", filter="data")
            with suppress(OSError):  # somebody else was faster
                (Path(made) / "build").rename(folder)
    if not (folder / "lndrl/bench").is_dir():
        raise UserError(f"--vs {commit}: that build has no lndrl bench")
    # Before there was a second world the first one had no file of its own.
    first = () if (folder / "configs" / _FIRST_WORLD).exists() else _first_world()
    return Other(whole[:12], folder, first)


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
    builds = {"own": (_ROOT, other.settings), "other": (other.folder, ())}
    found: dict[str, dict[str, list[float]]] = {
        figure: {"own": [], "other": []} for figure in FIGURES[name]
    }
    for side, (folder, settings) in builds.items():
        say(f"compiling what {_called(side, other)} needs")
        _measured("world" if name == "train" else name, folder, settings, _WARM)
    for round_ in range(rounds):
        sides = list(builds) if round_ % 2 else list(builds)[::-1]
        for side in sides:
            say(f"round {round_ + 1} of {rounds}: {_called(side, other)}")
            figures = _measured(name, *builds[side], seconds)
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
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
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


def _first_world() -> tuple[str, ...]:
    """How this program's world is that of version 1 again, whatever its defaults are by now."""
    content = yaml.safe_load((REPOSITORY_CONFIGS / _FIRST_WORLD).read_text("utf-8"))
    return tuple(content["set"])


def _git(*arguments: str) -> bytes:
    if shutil.which("git") is None:
        raise UserError("--vs takes the other build out of a repository by git, which is missing")
    inside = subprocess.run(
        ["git", "-C", str(_ROOT), "rev-parse", "--git-dir"], capture_output=True, check=False
    )
    if inside.returncode:
        raise UserError(f"--vs: {_ROOT} is no git repository; run it from a clone")
    done = subprocess.run(["git", "-C", str(_ROOT), *arguments], capture_output=True, check=False)
    return done.stdout


def _made(folder: Path) -> Path:
    folder.mkdir(0o700, parents=True, exist_ok=True)
    return folder
