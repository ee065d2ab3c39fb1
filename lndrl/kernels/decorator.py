"""The decorator that makes a kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.dispatcher import Dispatcher

from lndrl.kernels.store import KernelCache


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """``numba.njit(**options)`` without the interpreter's lock, kept by what it is made of.

    numba's own ``cache=True`` looks only at the file that a function stands in; here an edited
    kernel is compiled anew together with all that call it, and two processes never compile the
    same one at the same time.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        made = njit(nogil=True, **options)(function)
        if isinstance(made, Dispatcher):  # else NUMBA_DISABLE_JIT
            made._cache = KernelCache(function)  # type: ignore[attr-defined]
        return made

    return decorate
