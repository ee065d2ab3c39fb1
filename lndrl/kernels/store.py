"""Where compiled kernels are kept: for whom they are good, and who compiles one that is missing.

    FOLDER/lndrl.world.laser-0123456789abcdef/   by file, and by what it is made of

Every clone and every process of a user shares them; what lies there is run, so the folder is the
user's own. numba adds processor, Python and its own version.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator

from lndrl.caches import kernel_folder
from lndrl.kernels.sources import ROOT, digest, name_of
from lndrl.kernels.watch import waiting

PATIENCE = 300.0
"""s that a kernel is waited for which another process compiles; then it is compiled here, too."""

KEPT = 6
"""Versions of a file whose kernels are kept: clones and branches that somebody works with."""

_RETRY, _TELL = 0.01, 1.0  # s


_HOW = "".join(
    f"-{name.lower()}"
    for name in ("BOUNDSCHECK", "DEBUGINFO_DEFAULT")
    if getattr(config, name, None)
)
"""What numba compiles otherwise where it is told to, in a folder's name."""


class _Locator(_CacheLocator):
    """A folder for a file's kernels, by what they are made of."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        path = Path(file).resolve()
        self._line = function.__code__.co_firstlineno
        self._stamp = digest(path) + _HOW
        self._folder = _folder_of(path)

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Locator | None:
        """None, and an error of numba's, where nothing can be kept."""
        locator = cls(function, file)
        try:
            locator.ensure_cache_path()
        except OSError:
            return None
        return locator

    def ensure_cache_path(self) -> None:
        """Make the folder; the oldest of other versions go."""
        if not self._folder.is_dir():
            os.makedirs(self._folder.parent, 0o700, exist_ok=True)
            self._folder.mkdir(exist_ok=True)
            _forget(self._folder)
        os.utime(self._folder)  # it is in use
        super().ensure_cache_path()

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """What the kernel is made of."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Two functions of a name stand in different lines."""
        return str(self._line)


class _Impl(CompileResultCacheImpl):
    _locator_classes = (_Locator,)


class KernelCache(FunctionCache):
    """What is kept of one kernel.

    numba asks for it before it compiles, and hands it over afterwards. In between this process
    holds the kernel's lock: whoever else needs it waits, and finds it here.
    """

    _impl_class = _Impl

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._lock = Path(self.cache_path) / f"{self._impl.filename_base}.lock"
        self._held: int | None = None

    @property
    def is_kept(self) -> bool:
        """Whether anything is: its kernel has been compiled, on a processor like this or not."""
        return os.path.exists(self._cache_file._index_path)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What is kept; None, with the lock held, where this process has to compile it."""
        kept = super().load_overload(sig, target_context)
        if kept is None and self._held is None:
            self._take()
            kept = super().load_overload(sig, target_context)
            if kept is not None:
                self._release()
        return kept

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it, and let go of the lock."""
        try:
            super().save_overload(sig, data)
        finally:
            self._release()

    def _take(self) -> None:
        """Take the lock, or do without where it cannot be had: then work is done twice."""
        try:
            descriptor = os.open(self._lock, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError:
            return
        self._held = descriptor
        if self._taken(descriptor):
            return
        with waiting() as tell:
            for i in range(round(PATIENCE / _RETRY)):
                if i % round(_TELL / _RETRY) == 0:
                    tell()
                time.sleep(_RETRY)
                if self._taken(descriptor):
                    return

    @staticmethod
    def _taken(descriptor: int) -> bool:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # a file system without locks
            pass
        return True

    def _release(self) -> None:
        if self._held is not None:
            with suppress(OSError):  # explicitly: a child that was forked holds it, too
                fcntl.flock(self._held, fcntl.LOCK_UN)
            os.close(self._held)
            self._held = None


def _forget(folder: Path) -> None:
    """Remove the oldest versions of the file that ``folder`` is a version of."""
    name = folder.name.partition("-")[0]
    with suppress(OSError):
        others = [
            (place.stat().st_mtime, place)
            for place in folder.parent.glob(f"{name}-*")
            if place != folder
        ]
        for _, place in sorted(others, reverse=True)[KEPT - 1 :]:
            shutil.rmtree(place, ignore_errors=True)


def is_kept(module: str, name: str) -> bool:
    """Whether the kernel ``name`` of a ``module`` of the package is kept for this Python.

    Without importing the module, and whatever processor it was compiled for.
    """
    path = ROOT.joinpath(*module.split(".")).with_suffix(".py")
    python = f"py{sys.version_info[0]}{sys.version_info[1]}"
    return any(_folder_of(path).glob(f"{path.stem}.{name}-*.{python}*.nbi"))


def _folder_of(path: Path) -> Path:
    return Path(kernel_folder()) / f"{name_of(path)}-{digest(path)}{_HOW}"
