"""Threads of products, and the code that they take."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch
from threadpoolctl import threadpool_info

from lndrl.machine import threads
from lndrl.machine.threads import CORE_TYPE, kept_threads, set_threads, use_wide_products

WIDE = "fpu avx2 avx512f avx512dq avx512cd avx512bw avx512vl"


def blas_threads() -> set[int]:
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


def test_numpy_and_torch_get_as_many_and_then_their_own_back() -> None:
    before = blas_threads(), torch.get_num_threads()
    with kept_threads():
        for count in (1, 2):
            set_threads(count)
            assert (blas_threads(), torch.get_num_threads()) == ({count}, count)
    assert (blas_threads(), torch.get_num_threads()) == before


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch):
    """Sets who made the processor and what it can; returns what OpenBLAS is told then."""
    monkeypatch.delenv(CORE_TYPE, raising=False)

    def told(vendor: str, flags: str) -> str | None:
        monkeypatch.setattr(threads, "vendor", lambda: vendor)
        monkeypatch.setattr(threads, "features", lambda: frozenset(flags.split()))
        use_wide_products()
        return os.environ.get(CORE_TYPE)

    return told


def test_amds_with_avx512_are_told_to_use_it(machine) -> None:
    assert machine("AuthenticAMD", WIDE) == "SkylakeX"


@pytest.mark.parametrize(
    ("vendor", "flags"),
    [
        ("GenuineIntel", WIDE),  # is known to OpenBLAS
        ("AuthenticAMD", "fpu avx2"),
        ("AuthenticAMD", WIDE.replace("avx512vl", "")),
        ("", ""),
    ],
)
def test_others_are_left_alone(machine, vendor: str, flags: str) -> None:
    assert machine(vendor, flags) is None


def test_what_the_user_has_set_stays(machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CORE_TYPE, "Zen")
    assert machine("AuthenticAMD", WIDE) == "Zen"


def test_another_openblas_may_lack_the_code(machine, monkeypatch: pytest.MonkeyPatch) -> None:
    class Spec:
        origin = "/usr/lib/python3/dist-packages/numpy/__init__.py"

    monkeypatch.setattr(threads, "find_spec", lambda name: Spec)
    assert not Path("/usr/lib/python3/dist-packages/numpy.libs").exists()
    assert machine("AuthenticAMD", WIDE) is None
