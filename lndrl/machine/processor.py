"""What processor this machine has."""

from __future__ import annotations

import platform
from functools import cache
from pathlib import Path


@cache
def model(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """Its name, for people."""
    return _entry(cpuinfo, "model name") or platform.processor() or platform.machine()


@cache
def vendor(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """Who made it as it says itself, e.g. AuthenticAMD or GenuineIntel; empty where unknown."""
    return _entry(cpuinfo, "vendor_id")


def _entry(cpuinfo: Path, key: str) -> str:
    try:
        lines = cpuinfo.read_text("utf-8").splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if line.startswith(key)), "")
