"""The decorator that makes a kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.dispatcher import Dispatcher

from lndrl.kernels.store import KernelCache

_STATED: dict[str, Any] = {
    "_nrt": True,
    "error_model": "numpy",
    "fastmath": False,
    "forceinline": False,
}
"""What numba 0.68 otherwise takes over from whichever kernel happens to compile this one first, and
keeps for all others and on disk: what a kernel computes would depend on who called it."""


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """``numba.njit(**options)`` without the interpreter's lock, kept by what it is made of.

    Divides as NumPy does, unless told otherwise: by zero it gives infinity or NaN, and no error.

    numba's own ``cache=True`` looks only at the file that a function stands in; here an edited
    kernel is compiled anew together with all that call it, and two processes never compile the
    same one at the same time.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        made = njit(nogil=True, **(_STATED | options))(function)
        if isinstance(made, Dispatcher):  # else NUMBA_DISABLE_JIT
            made._cache = KernelCache(function)  # type: ignore[attr-defined]
        return made

    return decorate
