"""Cores by affinity mask and by cgroup quota: made-up machines, and this one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from lndrl.machine import cores
from lndrl.machine.cores import (
    THREAD_VARIABLES,
    cpu_quota,
    limit_threads,
    usable_cores,
    usable_threads,
)

ROOT = Path(cores.__file__).resolve().parents[2]
V1 = "31 25 0:29 {group} {point} rw,relatime shared:9 - cgroup cgroup rw,cpu,cpuacct"
V2 = "31 25 0:29 {group} {point} rw,nosuid - cgroup2 cgroup2 rw,nsdelegate"
OTHER = """24 1 8:1 / / rw - ext4 /dev/sda1 rw
33 25 0:30 / /sys/fs/cgroup/cpuset rw - cgroup cgroup rw,cpuset"""


def machine(root: Path, mount: str, groups: str, **files: str) -> Path:
    """A root with /proc/self and cgroup ``files`` (their ``/`` written as ``__``)."""
    (root / "proc/self").mkdir(parents=True)
    (root / "proc/self/mountinfo").write_text(f"{OTHER}\n{mount}\n")
    (root / "proc/self/cgroup").write_text(groups)
    for name, text in files.items():
        path = root / "sys/fs/cgroup" / name.replace("__", "/").replace("cpu_", "cpu.")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def v2(root: Path, group: str = "/", inside: str = "/", **files: str) -> Path:
    return machine(root, V2.format(group=group, point="/sys/fs/cgroup"), f"0::{inside}\n", **files)


def v1(root: Path, group: str = "/", inside: str = "/", **files: str) -> Path:
    mount = V1.format(group=group, point="/sys/fs/cgroup/cpu,cpuacct")
    groups = f"9:name=systemd:/\n4:cpuacct,cpu:{inside}\n3:cpuset:/elsewhere\n0::/\n"
    return machine(root, mount, groups, **files)


def v1_files(folder: str, quota: int, period: int = 100_000) -> dict[str, str]:
    place = f"cpu,cpuacct/{folder}".rstrip("/").replace("/", "__")
    return {
        f"{place}__cpu_cfs_quota_us": f"{quota}\n",
        f"{place}__cpu_cfs_period_us": f"{period}\n",
    }


def test_v2_in_a_container(tmp_path: Path) -> None:
    assert cpu_quota(v2(tmp_path, cpu_max="150000 100000\n")) == 1.5


def test_v2_without_a_limit(tmp_path: Path) -> None:
    assert cpu_quota(v2(tmp_path, cpu_max="max 100000\n")) is None


def test_v2_nested_the_least_counts(tmp_path: Path) -> None:
    """systemd's CPUQuota on a slice limits the services in it; the root group has no cpu.max."""
    files = {
        "lab.slice__cpu_max": "200000 100000\n",
        "lab.slice__learner.service__cpu_max": "max 100000\n",
        "lab.slice__other.service__cpu_max": "50000 100000\n",
    }
    assert cpu_quota(v2(tmp_path, "/", "/lab.slice/learner.service", **files)) == 2.0


def test_v2_mounted_from_within(tmp_path: Path) -> None:
    """Without a namespace of its own a container sees the host's names of its group."""
    files = {"cpu_max": "300000 100000\n", "inner__cpu_max": "400000 100000\n"}
    assert cpu_quota(v2(tmp_path, "/docker/abc", "/docker/abc/inner", **files)) == 3.0


@pytest.mark.parametrize("inside", ["/../../elsewhere", "/elsewhere"])
def test_v2_of_another_namespace(tmp_path: Path, inside: str) -> None:
    assert cpu_quota(v2(tmp_path, "/docker/abc", inside, cpu_max="100000 50000\n")) == 2.0


def test_v1(tmp_path: Path) -> None:
    assert cpu_quota(v1(tmp_path, **v1_files("", 250_000))) == 2.5


def test_v1_without_a_limit(tmp_path: Path) -> None:
    assert cpu_quota(v1(tmp_path, **v1_files("", -1))) is None


def test_v1_nested_the_least_counts(tmp_path: Path) -> None:
    files = v1_files("", -1) | v1_files("pods", 50_000) | v1_files("pods/a", 400_000)
    assert cpu_quota(v1(tmp_path, "/", "/pods/a", **files)) == 0.5


def test_v1_beside_a_v2_without_the_controller(tmp_path: Path) -> None:
    root = v1(tmp_path, **v1_files("", 100_000))
    with (root / "proc/self/mountinfo").open("a") as file:
        file.write(V2.format(group="/", point="/sys/fs/cgroup/unified") + "\n")
    assert cpu_quota(root) == 1.0


def test_a_mount_point_with_a_space(tmp_path: Path) -> None:
    mount = V2.format(group="/", point=r"/sys/fs/cgroup/our\040groups")
    root = machine(tmp_path, mount, "0::/\n", **{"our groups__cpu_max": "200000 100000"})
    assert cpu_quota(root) == 2.0


@pytest.mark.parametrize("text", ["", "many 100000", "100000", "100000 0", "-1 100000", "0 100000"])
def test_what_cannot_be_read_limits_nothing(tmp_path: Path, text: str) -> None:
    assert cpu_quota(v2(tmp_path, cpu_max=text)) is None
    assert cpu_quota(tmp_path / "nowhere") is None


@pytest.mark.parametrize(
    ("quota", "cores"), [("50000", 1), ("100000", 1), ("150000", 2), ("900000", 4), ("max", 4)]
)
def test_the_smaller_of_mask_and_quota(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quota: str, cores: int
) -> None:
    monkeypatch.setattr("lndrl.machine.cores._affinity", lambda: 4)
    assert usable_cores(v2(tmp_path, cpu_max=f"{quota} 100000")) == cores


def test_libraries_hear_of_a_quota_only(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("lndrl.machine.cores._affinity", lambda: 4)
    monkeypatch.setattr("lndrl.machine.cores.cpu_quota", lambda root: None)
    limit_threads()
    assert "OMP_NUM_THREADS" not in os.environ
    monkeypatch.setattr("lndrl.machine.cores.cpu_quota", lambda root: 1.5)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    limit_threads()
    assert (os.environ["OMP_NUM_THREADS"], os.environ["MKL_NUM_THREADS"]) == ("2", "3")


@pytest.mark.skipif(shutil.which("taskset") is None, reason="needs taskset")
@pytest.mark.parametrize(
    ("text", "threads"),
    [("1", 1), ("3", 3), ("16", 4), ("2,1", 2), (None, 4), ("", 4), ("0", 4), ("many", 4)],
)
def test_the_user_may_allow_fewer_threads(
    monkeypatch: pytest.MonkeyPatch, text: str | None, threads: int
) -> None:
    monkeypatch.setattr(cores, "usable_cores", lambda: 4)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if text is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", text)
    assert usable_threads() == threads


def test_a_mask_of_this_machine() -> None:
    first = min(os.sched_getaffinity(0))
    code = "from lndrl.machine.cores import usable_cores; print(usable_cores())"
    command = ["taskset", "-c", str(first), sys.executable, "-c", code]
    assert subprocess.check_output(command, cwd=ROOT, text=True) == "1\n"


def test_nobody_else_counts_cores() -> None:
    """A count of the machine's cores says nothing about those that may be used."""
    for top in ("lndrl", "actors", "learner"):
        for path in (ROOT / top).rglob("*.py"):
            text = path.read_text()
            if path != ROOT / "lndrl/machine/cores.py":
                assert "cpu_count" not in text and "sched_getaffinity" not in text, path
