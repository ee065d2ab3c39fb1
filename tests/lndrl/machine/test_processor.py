"""Whose processor it is, by what Linux says of it."""

from __future__ import annotations

from pathlib import Path

from lndrl.machine.processor import model, vendor

TEXT = """processor\t: 0
vendor_id\t: AuthenticAMD
cpu family\t: 26
model name\t: AMD EPYC 9B45

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
