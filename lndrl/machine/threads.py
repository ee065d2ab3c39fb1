"""How many threads a process's matrix products take: NumPy's, and torch's where it is loaded."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from threadpoolctl import threadpool_limits

from lndrl.machine.processor import features, vendor

CORE_TYPE = "OPENBLAS_CORETYPE"
_WIDE = {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}


def set_threads(count: int, products: int | None = None) -> None:
    """Let products take ``count`` threads from now on; of torch those that this thread asks for.

    Those of NumPy take ``products`` where that is given.
    """
    threadpool_limits(products or count, user_api="blas")
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


def use_wide_products() -> None:
    """Let NumPy's products use AVX-512 on processors of AMD that have it.

    OpenBLAS 0.3.31 takes its code for AVX2 there, which is half as fast on Zen 5. To be called
    before NumPy is loaded. What the user has set stays, and so does any OpenBLAS but that of
    NumPy's own wheels: others need not have that code.
    """
    if vendor() == "AuthenticAMD" and features() >= _WIDE and _has_its_own_openblas():
        os.environ.setdefault(CORE_TYPE, "SkylakeX")


def _has_its_own_openblas() -> bool:
    found = find_spec("numpy")
    if found is None or found.origin is None:
        return False
    place = Path(found.origin).parent.with_name("numpy.libs")
    return any(place.glob("libscipy_openblas*"))
