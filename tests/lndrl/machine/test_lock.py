"""A folder for one process: who is refused, what is said, and what a crash leaves."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lndrl.errors import UserError
from lndrl.machine import lock as locks
from lndrl.machine.lock import FolderLock, check_free, held

ROOT = Path(locks.__file__).resolve().parents[2]
HOLDER = """
import subprocess, sys, time
from pathlib import Path
from lndrl.machine.lock import FolderLock
lock = FolderLock(Path(sys.argv[1]), "a learner", "stop it", patience=0.0)
command = [sys.executable, "-c", "import time; time.sleep(600)"]
child = subprocess.Popen(command, pass_fds=[lock.fileno()] if sys.argv[2:] else [])
print(child.pid, flush=True)
time.sleep(600)
"""
Holder = tuple["subprocess.Popen[str]", int]


def hold(folder: Path, *more: str) -> Holder:
    """A process that holds ``folder`` and has a child, which holds it as well if ``more``."""
    command = [sys.executable, "-c", HOLDER, str(folder), *more]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    return process, int(process.stdout.readline())


@pytest.fixture
def holders() -> Iterator[list[Holder]]:
    started: list[Holder] = []
    yield started
    for process, child in started:
        for pid in (process.pid, child):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        process.communicate()


def take(folder: Path, patience: float = 0.0) -> FolderLock:
    return FolderLock(folder, "a learner", "stop it", patience)


def test_the_second_is_told_host_and_process(tmp_path: Path, holders: list[Holder]) -> None:
    holders.append(hold(tmp_path))
    process, _ = holders[0]
    with pytest.raises(UserError) as refused:
        take(tmp_path)
    words = f"a learner is still at work there, process {process.pid} on {socket.gethostname()} "
    assert str(refused.value).startswith(f"{tmp_path}: {words}")
    assert str(refused.value).endswith("; stop it")
    with pytest.raises(UserError, match="still at work there"):
        check_free(tmp_path, "a learner", "stop it")


def test_a_crash_lets_the_successor_in_at_once(tmp_path: Path, holders: list[Holder]) -> None:
    """Children that survive it, such as actors, do not keep a folder that they were not given."""
    holders.append(hold(tmp_path))
    process, child = holders[0]
    process.kill()
    process.wait()
    os.kill(child, 0)
    take(tmp_path).release()


def test_a_child_that_was_given_it_holds_it_as_well(tmp_path: Path, holders: list[Holder]) -> None:
    holders.append(hold(tmp_path, "give"))
    process, child = holders[0]
    process.kill()
    process.wait()
    with pytest.raises(UserError, match="still at work there"):
        take(tmp_path)
    os.kill(child, signal.SIGKILL)
    take(tmp_path, patience=60.0).release()


def test_one_process_cannot_take_it_twice(tmp_path: Path) -> None:
    with take(tmp_path) as first:
        with pytest.raises(UserError, match=f"process {os.getpid()} on"):
            take(tmp_path)
        first.release()
        take(tmp_path).release()
    check_free(tmp_path, "a learner", "stop it")


@pytest.mark.parametrize("note", [b"", b"{", b"[]", b'{"host": "a", "pid": "x"}', b"\xff" * 9])
def test_a_note_that_cannot_be_read_only_costs_the_name(tmp_path: Path, note: bytes) -> None:
    with take(tmp_path):
        (tmp_path / "lock").write_bytes(note)
        with pytest.raises(UserError, match="a learner is still at work there; stop it"):
            take(tmp_path)


def test_a_name_cannot_steer_a_terminal(tmp_path: Path) -> None:
    with take(tmp_path):
        (tmp_path / "lock").write_text('{"host": "a\\u001b[2J", "pid": 1, "command": "b\\nc"}')
        with pytest.raises(UserError, match=r"process 1 on a\?\[2J \(b\?c\); stop it"):
            take(tmp_path)


def test_a_full_disk_costs_the_note_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(locks.os, "pwrite", full)
    with take(tmp_path), pytest.raises(UserError, match="still at work there; stop it"):
        take(tmp_path)


def test_what_cannot_be_locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="file: cannot be written"), held(tmp_path / "file", "", ""):
        pass
    check_free(tmp_path / "nowhere", "a learner", "stop it")

    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(locks.fcntl, "flock", none)
    with pytest.raises(OSError, match="No locks available"):
        take(tmp_path)
    check_free(tmp_path, "a learner", "stop it")
