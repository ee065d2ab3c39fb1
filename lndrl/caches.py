"""Where compiled kernels and fonts are kept, also where neither package nor home can be written.

numba refuses to import a kernel that it cannot keep anywhere, and matplotlib looks for all fonts
anew in every process. Both read the environment when they are imported, which child processes
inherit; so this is settled once, when the package is.
"""

from __future__ import annotations

import os
import stat
import sys

NUMBA, MATPLOTLIB = "NUMBA_CACHE_DIR", "MPLCONFIGDIR"
NOWHERE = (
    "compiled kernels cannot be kept: neither the installation, nor the home folder, nor a"
    f" temporary folder can be written; let {NUMBA} or TMPDIR name one that can"
)
"""What is wrong where not even a temporary folder is found."""


def settle(package: str = os.path.dirname(__file__)) -> None:
    """Name a temporary folder to numba and matplotlib where they have none; a warning says so.

    Nothing is written where they have one. ``package`` is what numba would write beside.
    """
    if os.path.exists(".numba_config.yaml"):
        # The environment wins over that file of the working folder: what is loaded as kernels runs,
        # so a folder that somebody downloaded must not say where it comes from.
        os.environ.setdefault(NUMBA, "")
    homeless = {}
    if not _is_writable(kernel_folder(package)):
        homeless[NUMBA] = "numba"
    if not _matplotlib_has_a_place():
        homeless[MATPLOTLIB] = "matplotlib"
    if not homeless:
        return
    folder = _temporary_folder()
    if folder is None:
        return
    for variable, name in homeless.items():
        os.environ[variable] = os.path.join(folder, name)
    if "numba.core.config" in sys.modules:
        sys.modules["numba.core.config"].reload_config()
    what = "compiled kernels" if NUMBA in homeless else "fonts"
    import logging

    logging.getLogger("lndrl").warning(
        "neither the installation nor the home folder can be written: %s are kept in %s"
        " (%s chooses another place)",
        *(what, folder, " or ".join(homeless)),
    )


def kernel_folder(package: str = os.path.dirname(__file__)) -> str:
    """The folder of compiled kernels.

    NUMBA_CACHE_DIR; else in the user's cache folder, where clones and environments share them; else
    beside the code.
    """
    given = os.environ.get(NUMBA)
    if given:
        return given
    own = user_cache("kernels")
    beside = os.path.join(package, "__pycache__", "kernels")
    return own if _is_writable(own) or not _is_writable(beside) else beside


def user_cache(room: str) -> str:
    """The folder ``room`` in what this program caches for the user."""
    return os.path.join(_home("XDG_CACHE_HOME", ".cache"), "lndrl", room)


def _matplotlib_has_a_place() -> bool:
    given = os.environ.get(MATPLOTLIB)
    if given:
        return _is_writable(given)
    homes = (_home("XDG_CONFIG_HOME", ".config"), _home("XDG_CACHE_HOME", ".cache"))
    return all(_is_writable(os.path.join(home, "matplotlib")) for home in homes)


def _home(variable: str, usual: str) -> str:
    return os.environ.get(variable) or os.path.join(os.path.expanduser("~"), usual)


def _is_writable(folder: str) -> bool:
    """Whether files can be made in ``folder``, which may still have to be made itself."""
    above = folder
    while not os.path.lexists(above):
        above = os.path.dirname(above)
    if not os.path.isdir(above) or not os.access(above, os.W_OK | os.X_OK):
        return False
    if above == folder or os.path.isdir(os.path.expanduser("~")):
        return True
    trial = os.path.join(above, f".lndrl-{os.getpid()}")
    try:  # a home like /proc/none lies in what only claims to be writable
        os.mkdir(trial, 0o700)
        os.rmdir(trial)
    except OSError:
        return False
    return True


def _temporary_folder() -> str | None:
    """A folder of this user's own, the same the next time; None where nothing can be written.

    What lies in it is run: a folder that somebody else made under that name is not taken.
    """
    import tempfile

    try:
        folder = os.path.join(tempfile.gettempdir(), f"lndrl-cache-{os.geteuid()}")
        os.makedirs(folder, 0o700, exist_ok=True)
        found = os.lstat(folder)
        private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o077
        if private and found.st_uid == os.geteuid() and _is_writable(folder):
            return folder
        return tempfile.mkdtemp(prefix="lndrl-cache-")
    except OSError:
        return None
