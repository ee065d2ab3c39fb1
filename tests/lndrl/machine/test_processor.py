"""Whose processor it is, by what Linux says of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from lndrl.machine.processor import described, model, vectors, vendor

TEXT = """processor\t: 0
vendor_id\t: AuthenticAMD
cpu family\t: 26
model name\t: AMD EPYC 9B45
flags\t\t: fpu sse2 avx avx2 avx512f avx512dq

processor\t: 1
vendor_id\t: AuthenticAMD
"""


def test_maker_and_name(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text(TEXT)
    assert vendor(tmp_path / "cpuinfo") == "AuthenticAMD"
    assert model(tmp_path / "cpuinfo") == "AMD EPYC 9B45"


def test_elsewhere_nobody_knows(tmp_path: Path) -> None:
    assert vendor(tmp_path / "none") == ""
    assert model(tmp_path / "none")


@pytest.mark.parametrize(
    ("flags", "widest"), [("sse2 avx2 avx512f", "AVX-512"), ("avx avx2", "AVX2"), ("sse2 avx", "")]
)
def test_the_widest_vector_instructions(tmp_path: Path, flags: str, widest: str) -> None:
    (tmp_path / "cpuinfo").write_text(f"flags\t\t: fpu {flags}\n")
    assert vectors(tmp_path / "cpuinfo") == widest


def test_a_machine_in_words() -> None:
    words = described(2)
    assert words.startswith(f"{model()}, 2 cores") and words.endswith(vectors() or "cores")
