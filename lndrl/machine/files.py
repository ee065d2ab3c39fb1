"""How many files and connections a process may have open."""

from __future__ import annotations

import resource


def raise_file_limit() -> int:
    """Let this process open as many files as the system allows it; returns how many.

    Every connection is one, and the usual soft limit of 1,024 is kept for programs that know no
    more: a learner with a thousand actors is not among them.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    except (ValueError, OSError):  # no such number of files, on systems without a limit
        return soft
    return hard
