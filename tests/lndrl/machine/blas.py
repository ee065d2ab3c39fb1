"""How many threads NumPy's products take, for tests."""

from __future__ import annotations

from threadpoolctl import threadpool_info


def blas_threads() -> set[int]:
    """Of all libraries that do products, but for torch's own."""
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}
