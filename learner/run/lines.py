"""Lines appended to a file on a disk that may refuse: nothing here raises."""

from __future__ import annotations

import errno
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import BinaryIO

_RETRY = 1.0  # s between attempts while the disk refuses
_BLOCK = 4096


class LineFile:
    """Appends whole lines; what the disk refuses is kept and written when it works again.

    A line that a killed process left half written is cut off first. Thread-safe.

    Args:
        path: made when the first line comes.
        on_change: hears why the disk refuses once it does, and None once it works again.
        limit: bytes from which the file becomes ``PATH.1`` and a new one begins; None: never.
        older: how many files before it are kept, ``PATH.1`` the newest of them.
        keep: lines kept while the disk refuses; the oldest go first and are counted in ``lost``.
    """

    def __init__(
        self,
        path: Path,
        on_change: Callable[[OSError | None], None] = lambda error: None,
        limit: int | None = None,
        keep: int = 10_000,
        older: int = 1,
    ) -> None:
        self.path = path
        self.lost = 0
        self._on_change = on_change
        self._limit = limit
        self._older = older
        self._waiting: deque[bytes] = deque(maxlen=keep)
        self._descriptor: int | None = None
        self._size = 0
        self._refused_at: float | None = None
        self._lock = Lock()

    def add(self, line: str) -> None:
        """Append one line; returns when the system has it, or it waits."""
        with self._lock:
            self.lost += len(self._waiting) == self._waiting.maxlen
            self._waiting.append(line.encode("utf-8", "backslashreplace") + b"\n")
            refused = self._refused_at
            if refused is None or time.monotonic() >= refused + _RETRY:
                self._flush()

    def flush(self) -> bool:
        """Try now to write what waits; whether nothing waits any more."""
        with self._lock:
            self._flush()
            return not self._waiting

    def size(self) -> int:
        """Bytes in the file, as far as this process has written or found them."""
        with self._lock:
            return self._size

    def rotate(self) -> bool:
        """Call the file ``PATH.1``, what was called so ``PATH.2``, and begin a new one."""
        with self._lock:
            return self._rotate()

    def close(self) -> None:
        """Write what waits, as far as possible, and close; a later line opens it again."""
        with self._lock:
            if self._waiting:
                self._flush()
            self._release()

    def _flush(self) -> None:
        try:
            if self._descriptor is None:
                self._open()
            self._write(b"".join(self._waiting))
        except OSError as error:
            # Opened anew next time: the folder may have been moved or mounted otherwise.
            self._release()
            first, self._refused_at = self._refused_at is None, time.monotonic()
            if first:
                self._on_change(error)
            return
        self._waiting.clear()
        again, self._refused_at = self._refused_at is not None, None
        if again:
            self._on_change(None)
        if self._limit is not None and self._size > self._limit:
            self._rotate()

    def _write(self, data: bytes) -> None:
        assert self._descriptor is not None
        if not data:
            return
        try:
            written = os.write(self._descriptor, data)
            if written < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._descriptor, self._size)
            raise
        self._size += written

    def _open(self) -> None:
        self._descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        end = size = os.fstat(self._descriptor).st_size
        while end > 0:
            begin = max(0, end - _BLOCK)
            newline = os.pread(self._descriptor, end - begin, begin).rfind(b"\n")
            end = begin if newline < 0 else begin + newline + 1
            if newline >= 0:
                break
        if end < size:
            os.ftruncate(self._descriptor, end)
        self._size = end

    def _rotate(self) -> bool:
        self._release()
        names = [self.path, *older_files(self.path, self._older)]
        try:
            for older, newer in pairwise(reversed(names)):
                if newer.exists():
                    os.replace(newer, older)
        except OSError:
            return False
        self._size = 0
        return True

    def _release(self) -> None:
        if self._descriptor is not None:
            with suppress(OSError):
                os.close(self._descriptor)
            self._descriptor = None


def older_files(path: Path, most: int) -> list[Path]:
    """What the files before ``path`` are called, the newest first; they need not exist."""
    return [path.with_name(f"{path.name}.{number}") for number in range(1, most + 1)]


def backwards(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """(offset behind it, line without its end), the last line first, read as far as is asked for.

    What follows the last line's end counts as a line, though it may be empty.
    """
    position = edge = end = file.seek(0, os.SEEK_END)
    tail = b""  # of a line that begins before ``position``; it stops at ``edge``
    while position > 0:
        begin = max(0, position - _BLOCK)
        file.seek(begin)
        tail, *lines = (file.read(position - begin) + tail).split(b"\n")
        for line in reversed(lines):
            yield end, line
            end = edge - len(line)
            edge = end - 1
        position = begin
    yield end, tail
