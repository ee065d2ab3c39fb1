"""What processor this machine has."""

from __future__ import annotations

import platform
from functools import cache
from pathlib import Path

from lndrl.wording import counted

_VECTORS = (("avx512f", "AVX-512"), ("avx2", "AVX2"))


@cache
def model(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """Its name, for people."""
    return _entry(cpuinfo, "model name") or platform.processor() or platform.machine()


@cache
def vendor(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """Who made it as it says itself, e.g. AuthenticAMD or GenuineIntel; empty where unknown."""
    return _entry(cpuinfo, "vendor_id")


@cache
def vectors(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """The widest vector instructions that it has, AVX-512 or AVX2; empty for others."""
    flags = _entry(cpuinfo, "flags").split()
    return next((name for flag, name in _VECTORS if flag in flags), "")


def described(cores: int) -> str:
    """It and how many ``cores`` may be used, as a table of figures names a machine."""
    return ", ".join(filter(None, (model(), counted(cores, "core"), vectors())))


def _entry(cpuinfo: Path, key: str) -> str:
    try:
        lines = cpuinfo.read_text("utf-8").splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if line.startswith(key)), "")
