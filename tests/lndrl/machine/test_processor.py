"""Whose processor it is, by what Linux says of it."""

from __future__ import annotations

from pathlib import Path

from lndrl.machine.processor import features, model, vendor

TEXT = """processor\t: 0
vendor_id\t: AuthenticAMD
cpu family\t: 26
model name\t: AMD EPYC 9B45
flags\t\t: fpu avx2 avx512f

processor\t: 1
vendor_id\t: AuthenticAMD
"""


def test_maker_and_name(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text(TEXT)
    assert vendor(tmp_path / "cpuinfo") == "AuthenticAMD"
    assert model(tmp_path / "cpuinfo") == "AMD EPYC 9B45"


def test_what_it_can(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text(TEXT)
    assert features(tmp_path / "cpuinfo") == {"fpu", "avx2", "avx512f"}


def test_elsewhere_nobody_knows(tmp_path: Path) -> None:
    assert features(tmp_path / "none") == frozenset()
    assert vendor(tmp_path / "none") == ""
    assert model(tmp_path / "none")
