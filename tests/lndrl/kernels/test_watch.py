"""Whoever waits for kernels hears how many of how many there are; who has them hears nothing."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from ast import literal_eval
from pathlib import Path
from typing import Any

import pytest

from lndrl import kernels

ROOT = Path(__file__).resolve().parents[3]


def run(script: str, **environment: str) -> tuple[str, str]:
    """What a process of its own prints to stdout and to stderr."""
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True, text=True, encoding="utf-8", timeout=1800, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


COMPILES = """
import numpy as np
from lndrl import kernels
from lndrl.randomness import fill_uniforms, uniform
state = np.arange(1, 5, dtype=np.uint64)
heard = []
assert kernels.in_progress() is None
def report(ready, needed):
    assert kernels.in_progress() in (None, (ready, needed))
    heard.append((ready, needed))
with kernels.told(report):
    kernels.expect(uniform)
    uniform(state)
    fill_uniforms(state, np.zeros(3))
assert kernels.in_progress() is None
print(heard)
"""


def test_what_is_compiled_is_counted_and_what_is_kept_is_not(tmp_path: Path) -> None:
    heard = literal_eval(run(COMPILES, NUMBA_CACHE_DIR=str(tmp_path))[0])
    # uniform calls one other, which counts from the start; fill_uniforms only when it is called.
    assert heard[0] == (0, 2) and (2, 2) in heard and heard[-1] == (3, 3)
    assert [ready for ready, _ in heard] == sorted(ready for ready, _ in heard)
    assert run(COMPILES, NUMBA_CACHE_DIR=str(tmp_path)) == ("[]\n", "")


def test_who_asked_for_nothing_finds_it_in_the_log(tmp_path: Path) -> None:
    """Users of the Gymnasium environment and of the Python interface."""
    script = COMPILES.replace("with kernels.told(report):", "if True:")
    _, said = run(script, NUMBA_CACHE_DIR=str(tmp_path))
    expected = "compiling kernels, 0 of 2 ready; only the first start on a machine does that"
    assert said.splitlines().count(expected) == 1
    assert run(script, NUMBA_CACHE_DIR=str(tmp_path))[1] == ""


CALLS = """
import sys
from numba.core.dispatcher import Dispatcher
from lndrl import kernels
from lndrl.config import load_config
config = load_config(
    "configs/lndrl.yaml",
    ["localization.max_particles=600", "learner.privileged_critic={critic}"],
)
if {policy}:
    from actors.rollout import Rollout
    Rollout(config, 0, 1)
else:
    from lndrl.navigation import VectorNavigation
    VectorNavigation(config, 0, 1).step_velocities(__import__("numpy").zeros((1, 2)))
expected = kernels.expected()
found = {{id(v): v for m in list(sys.modules.values()) if m.__name__.startswith("lndrl")
          for v in vars(m).values() if isinstance(v, Dispatcher) and v.overloads}}
names = lambda chosen: sorted(f"{{k.py_func.__module__}}.{{k.py_func.__name__}}" for k in chosen)
reached = kernels.reached(found.values())
print(names(reached[i] for i in reached.keys() - expected.keys()))
print(names(expected[i] for i in expected.keys() - reached.keys()))
print(len(expected))
"""


@pytest.mark.parametrize(("policy", "critic"), [(True, False), (True, True), (False, False)])
def test_what_is_expected_is_what_is_called(policy: bool, critic: bool) -> None:
    """Else "of how many" would grow meanwhile, or never be reached."""
    lines = run(CALLS.format(policy=policy, critic=str(critic).lower()))[0].splitlines()
    missing, unused, count = map(literal_eval, lines)
    assert missing == [] and unused == []
    assert count > 100


def test_lines_come_at_once_and_then_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("lndrl.kernels.watch.time.monotonic", lambda: now)
    said: list[str] = []
    lines = kernels.Lines(said.append)
    for second in (0.0, 1.0, 9.9, 10.1, 15.0, 20.2):
        now = 100.0 + second
        lines(int(second), 31)
    assert [text.split(";")[0] for text in said] == [
        "compiling kernels, 0 of 31 ready",
        "compiling kernels, 10 of 31 ready",
        "compiling kernels, 20 of 31 ready",
    ]


def test_a_report_that_fails_stops_no_compiler(caplog: pytest.LogCaptureFixture) -> None:
    def fails(*progress: Any) -> None:
        raise OSError("the pipe is gone")

    caplog.set_level(logging.ERROR)
    with kernels.told(fails):
        kernels.tell(1, 2)
    assert "the pipe is gone" in caplog.text
