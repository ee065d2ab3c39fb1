"""A folder that one process works in at a time."""

from __future__ import annotations

import fcntl
import json
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

from lndrl.errors import UserError

LOCK_FILE = "lock"
PATIENCE = 1.0
"""s that a process which was just killed may still hold what it held."""

_RETRY = 0.05


class FolderLock:
    """Holds ``folder`` by its file ``lock`` until released, or until its holder is gone.

    The system releases it with the process, however that ends, so a crash blocks nobody. Children
    hold it only where they are handed its descriptor. It is flock's, which NFS clients of Linux
    hold at the server, so it holds between machines as well. What it does not cover: a mount with
    ``nolock`` or ``local_lock`` (each machine then sees its own holders alone), a file system
    without locks (OSError), and an NFS server that has not yet noticed that a machine died (the
    folder stays held for a lease, about 90 s, or until that machine is back).
    """

    def __init__(self, folder: Path, whose: str, advice: str, patience: float = PATIENCE) -> None:
        """Take ``folder``, waiting at most ``patience`` s.

        ``whose`` and ``advice`` are for the UserError that says who holds it: "a learner", "stop
        it". Raises OSError where the lock cannot be made.
        """
        self.file = folder / LOCK_FILE
        self._descriptor = -1
        self._descriptor = os.open(self.file, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            self._take(time.monotonic() + patience, f"{folder}: {whose} is still at work there")
        except BlockingIOError as error:
            self.release()
            raise UserError(f"{error}; {advice}") from None
        except BaseException:
            self.release()
            raise
        self._note()

    def fileno(self) -> int:
        """The descriptor: whoever inherits it holds the folder as well."""
        return self._descriptor

    def release(self) -> None:
        """Let others have the folder; can be called twice."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def __del__(self) -> None:
        self.release()

    def _take(self, deadline: float, refusal: str) -> None:
        while True:
            try:
                return fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() >= deadline:
                    raise BlockingIOError(f"{refusal}{self._holder()}") from None
            time.sleep(_RETRY)

    def _note(self) -> None:
        """Write down who holds it, for those who are refused; a full disk only costs the note."""
        holder = {"host": socket.gethostname(), "pid": os.getpid(), "command": _command()}
        with suppress(OSError):
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, json.dumps(holder).encode() + b"\n", 0)

    def _holder(self) -> str:
        """Who noted that it took the folder, in words; nothing where that cannot be read."""
        try:
            note = json.loads(os.pread(self._descriptor, 4096, 0))
            host, pid, command = str(note["host"]), int(note["pid"]), str(note["command"])
        except (OSError, ValueError, KeyError, TypeError):
            return ""
        words = f", process {pid} on {host} ({command})"
        return "".join(c if c.isprintable() else "?" for c in words[:300])


@contextmanager
def held(folder: Path, whose: str, advice: str) -> Iterator[FolderLock]:
    """Make ``folder`` and hold it; raises UserError where it is held or cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FolderLock(folder, whose, advice)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written ({error.strerror})") from None
    with lock:
        yield lock


def check_free(folder: Path, whose: str, advice: str) -> None:
    """Raise UserError where ``folder`` is held; one that cannot be locked is free."""
    if (folder / LOCK_FILE).exists():
        with suppress(OSError):
            FolderLock(folder, whose, advice).release()


def _command() -> str:
    """What was called, as short as it can be told."""
    program = Path(sys.argv[0] if sys.argv else "")
    name = program.parent.name if program.name == "__main__.py" else program.name
    return " ".join([name, *sys.argv[1:2]])
