"""Processes: what the system tells of those of others, and how one of ours is ended."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

GRACE = 10.0
"""s that a process has to end by itself once it is asked to."""


def descendants(pid: int) -> list[int]:
    """Process ids of all that a process started, directly or not."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text("utf-8").split()
    except OSError:
        return []
    found = [int(child) for child in children]
    return found + [other for child in found for other in descendants(child)]


def lives(pid: int) -> bool:
    """Whether a process exists and is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("utf-8").rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def end(process: subprocess.Popen[Any], grace: float = GRACE) -> None:
    """End a process and wait for it: SIGTERM, and SIGKILL where ``grace`` s are not enough."""
    process.terminate()
    try:
        process.wait(grace)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
