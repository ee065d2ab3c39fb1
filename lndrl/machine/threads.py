"""How many threads a process's matrix products take: NumPy's, and torch's where it is loaded."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


def set_numpy_threads(count: int) -> None:
    """Let NumPy's products take ``count`` threads from now on, whoever asks for them."""
    threadpool_limits(count, user_api="blas")


def set_threads(count: int) -> None:
    """Let products take ``count`` threads from now on; of torch those that this thread asks for."""
    set_numpy_threads(count)
    if (torch := sys.modules.get("torch")) is not None:
        torch.set_num_threads(count)


@contextmanager
def kept_threads() -> Iterator[None]:
    """Afterwards they are what they were, whatever was set in between."""
    torch = sys.modules.get("torch")
    before = None if torch is None else torch.get_num_threads()
    with threadpool_limits(None, user_api="blas"):
        try:
            yield
        finally:
            if torch is not None:
                torch.set_num_threads(before)
