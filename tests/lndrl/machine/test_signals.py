"""Signals that ask to stop, in processes of their own."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lndrl.machine import signals

ROOT = Path(signals.__file__).resolve().parents[2]
INT, TERM, HUP = signal.SIGINT, signal.SIGTERM, signal.SIGHUP

SERVICE = """
import select, sys
from lndrl.cli.signals import stop_on_signals
with stop_on_signals("a checkpoint") as stop:
    print("ready", flush=True)
    try:
        stop.wait(600)
        print("stopping", flush=True)
        while not select.select([sys.stdin], [], [], 0.05)[0]:
            pass
    except KeyboardInterrupt:
        print("at once", flush=True)
print("left", flush=True)
sys.exit(stop.exit_code)
"""
STARTING = """
import os, signal, subprocess, sys, time
from lndrl.machine.signals import starting_child
try:
    with starting_child():
        os.kill(os.getpid(), signal.SIGINT)
        child = subprocess.Popen([sys.executable, "-c", "import signal; "
            "print(sorted(map(int, signal.pthread_sigmask(signal.SIG_BLOCK, []))), flush=True)"])
        child.wait()
        print("whole", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@contextmanager
def started(code: str, *before: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [*before, sys.executable, "-c", code],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def lines(process: subprocess.Popen[str], count: int) -> list[str]:
    assert process.stdout is not None
    return [process.stdout.readline().strip() for _ in range(count)]


@pytest.mark.parametrize(
    ("numbers", "end", "code"),
    [
        ([INT], "left", 130),
        ([TERM], "left", 143),
        ([HUP], "left", 129),
        ([HUP, HUP], "left", 129),  # from the shell and from the system
        ([HUP, TERM], "left", 129),  # from whoever ends the session
        ([TERM, HUP], "left", 143),  # systemd's SendSIGHUP
        ([INT, INT], "at once", 130),
        ([HUP, TERM, TERM], "at once", 129),
    ],
)
def test_a_closed_terminal_is_no_impatience(
    numbers: list[signal.Signals], end: str, code: int
) -> None:
    with started(SERVICE) as process:
        assert lines(process, 1) == ["ready"]
        process.send_signal(numbers[0])
        assert lines(process, 1) == ["stopping"]
        assert process.stdout is not None and process.stdin is not None
        for number in numbers[1:]:
            process.send_signal(number)
            time.sleep(0.1)  # two that wait to be delivered would be one
        # On a busy machine they may have been one all the same.
        while end == "at once" and not select.select([process.stdout], [], [], 10.0)[0]:
            process.send_signal(numbers[-1])
        if end == "left":
            process.stdin.write("\n")
            process.stdin.flush()
        assert lines(process, 1) == [end]
        assert process.wait(60) == code


def test_what_nohup_ignores_stays_ignored() -> None:
    with started(SERVICE, "nohup") as process:
        assert lines(process, 1) == ["ready"]
        process.send_signal(HUP)
        process.send_signal(TERM)
        assert lines(process, 1) == ["stopping"]
        process.communicate("\n")
        assert process.returncode == 143


def test_a_child_starts_whole_and_hears_nothing() -> None:
    with started(STARTING) as process:
        blocked = str(sorted((int(INT), int(TERM), int(HUP))))
        assert lines(process, 3) == [blocked, "whole", "interrupted"]


def test_nobody_else_lists_stop_signals() -> None:
    """A list of its own is one that lacks the next signal."""
    for top in ("lndrl", "actors", "learner"):
        for path in (ROOT / top).rglob("*.py"):
            if path != ROOT / "lndrl/machine/signals.py":
                assert "signal.signal(" not in path.read_text(), path


def test_what_is_printed_to_a_file_still_goes_there(tmp_path: Path) -> None:
    code = (
        "import os\nfrom lndrl.machine.signals import leave_terminal\n"
        "leave_terminal()\nprint('after')\n"
    )
    out = tmp_path / "out"
    with out.open("w") as file:
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, stdout=file, check=True)
    assert out.read_text() == "after\n"
    assert os.path.exists(out)
