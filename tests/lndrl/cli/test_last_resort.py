"""A process that hangs after Ctrl-C is ended, wherever it hangs."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

PROGRAM = """
import ctypes, sys, time
from lndrl.cli.signals import last_resort, stop_on_signals
how = sys.argv[1]
with last_resort(0.5) as resort, stop_on_signals("it ends") as stop:
    print("ready", flush=True)
    if how == "in a library":  # where Python calls no handler
        libc, mutex = ctypes.CDLL(None), ctypes.create_string_buffer(64)
        libc.pthread_mutex_lock(mutex)
        libc.pthread_mutex_lock(mutex)
    stop.wait(20.0)
    if how == "at the end":
        time.sleep(20.0)
time.sleep(0.8)
print("orderly", flush=True)
"""


@pytest.mark.parametrize(
    ("how", "code"), [("in a library", 130), ("at the end", 130), ("nowhere", 0)]
)
def test_who_hangs_is_ended(how: str, code: int) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, how], text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20.0)
    assert process.returncode == code
    assert out == ("orderly\n" if code == 0 else "")
    assert ("something hangs: ended at once, 0.5 s after" in err) == (code != 0)
    assert "Traceback" not in err
