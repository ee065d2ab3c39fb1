"""A small package of the name lndrl with two kernels of its own, one of which calls the other."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]

INNER = """
from lndrl.kernels import kernel
from lndrl.constants import STEP

@kernel()
def inner(x):
    return x + STEP
"""
OUTER = """
from lndrl.inner import inner
from lndrl.kernels import kernel

@kernel(error_model="numpy")
def outer(x):
    return 10 * inner(x)
"""
SCRIPT = """
import json, sys, time, os
from numba.core import event
compiled = []
class Listener(event.Listener):
    def on_start(self, event):
        compiled.append(event.data["dispatcher"].py_func.__name__)
        {when_compiling}
    def on_end(self, event):
        pass
event.register("numba:compile", Listener())
from lndrl.outer import outer
print(json.dumps([outer(1), sorted(compiled)]))
"""


def make_package(folder: Path, step: int = 1) -> Path:
    """Write the package to ``folder``; returns that."""
    package = folder / "lndrl"
    package.mkdir(parents=True)
    for file in (ROOT / "lndrl").glob("*.py"):
        shutil.copy(file, package)
    shutil.copytree(
        ROOT / "lndrl/kernels", package / "kernels", ignore=shutil.ignore_patterns("__pycache__")
    )
    (package / "inner.py").write_text(INNER)
    (package / "outer.py").write_text(OUTER)
    (package / "constants.py").write_text(f"STEP = {step}\n")
    return folder


def start(folder: Path, kept: Path, when_compiling: str = "pass") -> subprocess.Popen[str]:
    """A process that calls ``outer`` of the package in ``folder``; kernels are kept in ``kept``."""
    return subprocess.Popen(
        [sys.executable, "-P", "-c", SCRIPT.format(when_compiling=when_compiling)],
        env={**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(kept)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder,
    )  # fmt: skip


def result(process: subprocess.Popen[str]) -> tuple[int, list[str]]:
    """What ``outer(1)`` was, and what was compiled for it."""
    out, err = process.communicate(timeout=600)
    assert process.returncode == 0, err
    value, compiled = json.loads(out)
    return value, compiled
