"""How many cores this process may use: by its affinity mask and by its cgroup's quota."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
"""What numerical libraries read, when they are loaded, to know how many threads they may have."""

_OCTAL = re.compile(r"\\([0-7]{3})")


class _Mount(NamedTuple):
    """A cgroup hierarchy with a CPU quota: where it is mounted, and which group lies there."""

    version: int
    group: PurePosixPath
    point: PurePosixPath


def usable_cores(root: Path = Path("/")) -> int:
    """Cores that this process may keep busy, at least 1.

    The smaller of the affinity mask (taskset, cpuset; from Python 3.13 on PYTHON_CPU_COUNT goes
    before it) and the CPU quota of the process's cgroup or any around it (a container's limit,
    systemd's CPUQuota), rounded up, as a part of a core is used only by one more thread. ``root``
    is where /proc and the cgroups are looked for.
    """
    cores = _affinity()
    quota = cpu_quota(root)
    return cores if quota is None else max(1, min(cores, math.ceil(quota)))


def cpu_quota(root: Path = Path("/")) -> float | None:
    """Cores' worth of time that the process's cgroups leave it, None where none limits it.

    cgroup v1 (``cpu.cfs_quota_us``) and v2 (``cpu.max``), the least of a group and those around
    it. What cannot be read limits nothing.
    """
    groups = dict(_groups(root))
    quotas = [
        quota
        for mount in _mounts(root)
        if (group := groups.get(mount.version)) is not None
        for folder in _nested(root, mount, group)
        if (quota := _quota(folder, mount.version)) is not None
    ]
    return min(quotas, default=None)


def usable_threads() -> int:
    """Threads that computing may take: a core each, fewer where OMP_NUM_THREADS says so."""
    cores = usable_cores()
    try:
        asked = int(os.environ.get("OMP_NUM_THREADS", "").split(",")[0])
    except ValueError:  # not set, or nonsense that OpenMP passes over, too
        return cores
    return min(cores, asked) if asked > 0 else cores


def machine_cores() -> int:
    """Cores of the whole machine, whoever may use them: what its load is a share of."""
    return os.cpu_count() or 1


def allowed_cores() -> tuple[int, ...]:
    """Numbers of the cores that the affinity mask lets this process run on, ascending."""
    if hasattr(os, "sched_getaffinity"):
        return tuple(sorted(os.sched_getaffinity(0)))
    return tuple(range(machine_cores()))


def limit_threads() -> None:
    """Tell numerical libraries, before they are loaded, of a quota that they do not look at.

    An affinity mask they see by themselves. Where the user has set a variable, it stays.
    """
    cores = usable_cores()
    if cores < _affinity():
        for name in THREAD_VARIABLES:
            os.environ.setdefault(name, str(cores))


def _affinity() -> int:
    count = getattr(os, "process_cpu_count", None)  # since Python 3.13
    if count is not None:
        return int(count() or 1)
    return len(allowed_cores())


def _groups(root: Path) -> Iterator[tuple[int, PurePosixPath]]:
    """(version, group) of the hierarchies that may hold a CPU quota of this process."""
    for line in _lines(root / "proc/self/cgroup"):
        number, _, rest = line.partition(":")
        controllers, _, group = rest.partition(":")
        if number == "0" and not controllers:
            yield 2, PurePosixPath(group)
        elif "cpu" in controllers.split(","):
            yield 1, PurePosixPath(group)


def _mounts(root: Path) -> Iterator[_Mount]:
    for line in _lines(root / "proc/self/mountinfo"):
        before, _, after = line.partition(" - ")
        fields, kind = before.split(), after.split()
        if len(fields) < 5 or not kind:
            continue
        group, point = PurePosixPath(_plain(fields[3])), PurePosixPath(_plain(fields[4]))
        if kind[0] == "cgroup2":
            yield _Mount(2, group, point)
        elif kind[0] == "cgroup" and "cpu" in kind[-1].split(","):
            yield _Mount(1, group, point)


def _nested(root: Path, mount: _Mount, group: PurePosixPath) -> Iterator[Path]:
    """Folders of ``group`` and of those around it, as far as they are mounted."""
    if group.is_relative_to(mount.group) and ".." not in group.parts:
        inside = group.relative_to(mount.group)
    else:
        inside = PurePosixPath()  # of another namespace: what is mounted is all that is known
    place = root / str(mount.point).lstrip("/")
    for inner in (inside, *inside.parents):
        yield place / inner


def _quota(folder: Path, version: int) -> float | None:
    try:
        if version == 2:
            quota, period = (folder / "cpu.max").read_text("ascii").split()
        else:
            quota = (folder / "cpu.cfs_quota_us").read_text("ascii")
            period = (folder / "cpu.cfs_period_us").read_text("ascii")
        share = int(quota) / int(period)  # "max" is no number
    except (OSError, ValueError, ZeroDivisionError):
        return None
    return share if share > 0 else None  # v1 has -1 for none


def _plain(text: str) -> str:
    """A path of mountinfo without its octal escapes."""
    return _OCTAL.sub(lambda match: chr(int(match[1], 8)), text)


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text("utf-8", "replace").splitlines()
    except OSError:
        return []
