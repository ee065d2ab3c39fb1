"""Which wheels have to travel; the index itself is not asked."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def wheels() -> ModuleType:
    spec = importlib.util.spec_from_file_location("wheels", ROOT / "deploy/wheels.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


RESOLVED: dict[str, dict[str, Any]] = {
    "numba": {"version": "0.68.1", "requires_dist": ["numpy<2.5,>=2", "llvmlite==0.50"]},
    "numpy": {"version": "2.4.6"},
    "llvmlite": {"version": "0.50.0"},
    "eclipse-zenoh": {
        "version": "1.10.2",
        "requires_dist": ["old; python_version < '3.9'", "torch", "sphinx; extra == 'docs'"],
    },
}
NEEDED = [Requirement(each) for each in ("eclipse-zenoh>=1.10", "numba>=0.61", "torch>=2.11")]


def test_nothing_there_carries_all_but_torch(wheels: ModuleType) -> None:
    assert wheels.to_carry(NEEDED, RESOLVED, {}, "3.12") == [
        "eclipse-zenoh",
        "llvmlite",
        "numba",
        "numpy",
    ]


def test_what_fits_stays_with_all_that_it_needs(wheels: ModuleType) -> None:
    there = wheels.installed("numba==0.66.0\nnumpy==2.5.2\ntorch==2.11.0+cu130\n# a comment\n")
    assert wheels.to_carry(NEEDED, RESOLVED, there, "3.12") == ["eclipse-zenoh"]
    assert wheels.installed("Eclipse_Zenoh\n") == {"eclipse-zenoh": ""}


def test_what_is_too_old_or_too_new_is_carried(wheels: ModuleType) -> None:
    there = {"numba": "0.60.0", "numpy": "2.5.2", "llvmlite": "0.50.0"}
    assert wheels.to_carry(NEEDED, RESOLVED, there, "3.12") == ["eclipse-zenoh", "numba", "numpy"]


def test_what_another_python_alone_needs_is_said(wheels: ModuleType) -> None:
    with pytest.raises(wheels.CannotCarryError, match=r"old; .* is for Python 3\.8 alone"):
        wheels.to_carry(NEEDED, RESOLVED, {}, "3.8")


def test_platforms_are_all_older_ones_too(wheels: ModuleType) -> None:
    names = wheels.platforms("2.28")
    assert names[0] == "manylinux_2_28_x86_64" and "manylinux_2_29_x86_64" not in names
    assert {"manylinux_2_17_x86_64", "manylinux2014_x86_64", "manylinux1_x86_64"} <= set(names)
    for wrong in ("3", "2.x", "2.4", "1.28"):
        with pytest.raises(wheels.CannotCarryError, match="--glibc"):
            wheels.platforms(wrong)


def test_a_torch_that_is_too_old_is_refused(wheels: ModuleType, tmp_path: Path, capsys) -> None:
    assert wheels.main([str(tmp_path / "w"), "--torch", "2.10"]) == 1
    assert "torch 2.10 will not do; it must be >=2.11" in capsys.readouterr().err
    assert wheels.main([str(tmp_path / "w"), "--installed", str(tmp_path / "no.txt")]) == 2
    assert "no.txt: No such file" in capsys.readouterr().err


def test_the_folder_holds_pins_of_what_was_asked_for(
    wheels: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    asked: list[list[str]] = []

    def pip(arguments: list[str]) -> None:
        asked.append(arguments)
        if "--report" in arguments:
            report = Path(arguments[arguments.index("--report") + 1])
            items = [
                {"metadata": {"name": each.name, "version": "9.0"}}
                for each in wheels.wanted(ROOT / "pyproject.toml")
            ]
            report.write_text(json.dumps({"install": items}))

    monkeypatch.setattr(wheels, "_pip", pip)
    there = tmp_path / "there.txt"
    there.write_text("numpy==2.5.2\nscipy\n")
    assert wheels.main([str(tmp_path / "w"), "--installed", str(there)]) == 0
    pins = (tmp_path / "w/requirements.txt").read_text().splitlines()
    assert "eclipse-zenoh==9.0" in pins and "pytest==9.0" in pins
    assert not [pin for pin in pins if pin.split("==")[0] in ("torch", "numpy", "scipy", "mypy")]
    resolve, download = asked
    assert "torch" not in " ".join(resolve[resolve.index("--constraint") + 2 :])
    assert {"--no-deps", "--only-binary=:all:", "3.12", *pins} <= set(download)
    assert f"{len(pins)} packages" in capsys.readouterr().out
