from __future__ import annotations

import signal
import subprocess
import sys

from lndrl.machine.processes import descendants, end, lives

IGNORES = "signal.signal(signal.SIGTERM, signal.SIG_IGN)"
STUBBORN = f"import signal, time; {IGNORES}; print(1, flush=True)"


def test_who_ends_when_asked_is_not_killed() -> None:
    process = subprocess.Popen(["sleep", "60"])
    assert lives(process.pid)
    end(process)
    assert process.returncode == -signal.SIGTERM and not lives(process.pid)
    end(process)  # who has ended is not asked again


def test_who_does_not_is_killed() -> None:
    command = [sys.executable, "-c", f"{STUBBORN}; time.sleep(60)"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"1\n"
        end(process, grace=0.1)
    assert process.returncode == -signal.SIGKILL
    assert descendants(process.pid) == []
