"""Kept kernels: good for what they are made of, shared by clones, compiled by one at a time."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lndrl.kernels import store
from tests.lndrl.kernels.helpers_kernels import make_package, result, start

BOTH = ["inner", "outer"]


def test_a_kept_kernel_is_compiled_again_when_what_it_calls_was_edited(tmp_path: Path) -> None:
    """numba alone would go on with what it kept: it looks at a kernel's own file."""
    package, kept = make_package(tmp_path / "one"), tmp_path / "kept"
    assert result(start(package, kept)) == (20, BOTH)
    assert result(start(package, kept)) == (20, [])
    (package / "lndrl/constants.py").write_text("STEP = 2\n")
    assert result(start(package, kept)) == (30, BOTH)
    (package / "lndrl/outer.py").write_text(
        (package / "lndrl/outer.py").read_text().replace("10", "20")
    )
    assert result(start(package, kept)) == (60, ["outer"])
    (package / "lndrl/wording.py").write_text("# nothing that they need\n")
    assert result(start(package, kept)) == (60, [])


def test_clones_share_what_is_alike_and_keep_what_differs(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    one, two = (make_package(tmp_path / name) for name in ("one", "two"))
    other = make_package(tmp_path / "other", step=5)
    assert result(start(one, kept)) == (20, BOTH)
    assert result(start(two, kept)) == (20, [])
    assert result(start(other, kept)) == (60, BOTH)
    assert result(start(one, kept)) == (20, [])


def test_processes_that_start_together_compile_each_kernel_once(tmp_path: Path) -> None:
    package = make_package(tmp_path / "one")
    processes = [start(package, tmp_path / "kept", "time.sleep(1.0)") for _ in range(3)]
    results = [result(process) for process in processes]
    assert [value for value, _ in results] == [20] * 3
    assert sorted(name for _, compiled in results for name in compiled) == BOTH


def test_who_dies_while_compiling_blocks_nobody(tmp_path: Path) -> None:
    package, kept = make_package(tmp_path / "one"), tmp_path / "kept"
    assert start(package, kept, "os._exit(3)").wait(600) == 3
    assert result(start(package, kept)) == (20, BOTH)


def test_who_only_stands_still_is_waited_for_only_so_long(tmp_path: Path) -> None:
    package, kept = make_package(tmp_path / "one"), tmp_path / "kept"
    path = package / "lndrl/kernels/store.py"
    path.write_text(path.read_text().replace("PATIENCE = 300.0", "PATIENCE = 1"))
    stuck = start(package, kept, "print('here', flush=True); time.sleep(500)")
    assert stuck.stdout is not None and stuck.stdout.readline() == "here\n"
    assert result(start(package, kept)) == (20, BOTH)
    stuck.kill()
    stuck.communicate()


def test_with_bounds_checked_they_are_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package, kept = make_package(tmp_path / "one"), tmp_path / "kept"
    assert result(start(package, kept)) == (20, BOTH)
    monkeypatch.setenv("NUMBA_BOUNDSCHECK", "1")
    assert result(start(package, kept)) == (20, BOTH)
    monkeypatch.delenv("NUMBA_BOUNDSCHECK")
    assert result(start(package, kept)) == (20, [])


def test_only_the_newest_versions_of_a_file_are_kept(tmp_path: Path) -> None:
    for i in range(9):
        (tmp_path / f"lndrl.a-{i:016x}").mkdir()
        os.utime(tmp_path / f"lndrl.a-{i:016x}", (i, i))
    for other in ("lndrl.a.b-0000000000000000", "lndrl.b-0000000000000000"):
        (tmp_path / other).mkdir()
        os.utime(tmp_path / other, (0, 0))
    store._forget(tmp_path / f"lndrl.a-{0:016x}")
    left = sorted(place.name for place in tmp_path.iterdir())
    newest = [f"lndrl.a-{i:016x}" for i in (0, *range(9 - store.KEPT + 1, 9))]
    assert left == sorted([*newest, "lndrl.a.b-0000000000000000", "lndrl.b-0000000000000000"])
