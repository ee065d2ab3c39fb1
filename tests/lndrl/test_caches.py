"""An installation that cannot be written, without a home: kernels and fonts go to a folder."""

from __future__ import annotations

import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from lndrl.caches import MATPLOTLIB, NUMBA, settle

ROOT = Path(__file__).resolve().parents[2]
SENTENCE = "neither the installation nor the home folder can be written"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of what makes kernels, which nobody, not even root, can write caches beside."""
    copy = tmp_path / "read-only" / "lndrl"
    copy.mkdir(parents=True)
    for file in (ROOT / "lndrl").glob("*.py"):
        shutil.copy(file, copy)
    shutil.copytree(
        ROOT / "lndrl/kernels", copy / "kernels", ignore=shutil.ignore_patterns("__pycache__")
    )
    (copy / "__pycache__").write_text("a file in the place of the folder")
    monkeypatch.setenv("HOME", str(copy / "__init__.py" / "home"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    for name in (NUMBA, MATPLOTLIB, "XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, "")  # so that what a test sets is undone
        monkeypatch.delenv(name)
    return copy


SCRIPT = """
import os, sys
before = dict(os.environ)
import lndrl
assert "numba" not in sys.modules and "matplotlib" not in sys.modules
from lndrl.randomness import next_uint64
import matplotlib, numpy
next_uint64(numpy.arange(1, 5, dtype=numpy.uint64))
print(matplotlib.get_cachedir(), *next_uint64._cache._cache_path.split(), sep="\\n")
"""


def run(package: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(package.parent)}
    return subprocess.run(
        [sys.executable, "-P", "-c", SCRIPT],
        env=environment, capture_output=True, text=True, timeout=900, cwd=package.parent,
    )  # fmt: skip


def test_kernels_compile_and_fonts_are_found_in_a_temporary_folder(package: Path) -> None:
    folder = Path(os.environ["TMPDIR"]) / f"lndrl-cache-{os.geteuid()}"
    for _ in range(2):  # the second time in the same folder, with what is there
        done = run(package)
        assert done.returncode == 0, done.stderr
        assert done.stderr.count(SENTENCE) == 1 and str(folder) in done.stderr
        assert "Traceback" not in done.stderr and "MPLCONFIGDIR environment" not in done.stderr
        assert all(line.startswith(str(folder)) for line in done.stdout.split())
    assert list(folder.glob("numba/**/*.nbi"))
    assert folder.stat().st_mode & 0o777 == 0o700


def test_children_take_the_folder_over_and_say_nothing(
    package: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(NUMBA, str(tmp_path / "kernels"))
    monkeypatch.setenv(MATPLOTLIB, str(tmp_path / "fonts"))
    done = run(package)
    assert done.returncode == 0 and SENTENCE not in done.stderr
    assert list((tmp_path / "kernels").rglob("*.nbi"))


def test_a_folder_that_somebody_else_prepared_is_not_taken(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What lies in it would be run."""
    planted = tmp_path / "temporary" / f"lndrl-cache-{os.geteuid()}"
    planted.mkdir(mode=0o777)
    planted.chmod(0o777)
    settle(str(package))
    assert not os.environ[NUMBA].startswith(str(planted) + os.sep)
    assert Path(os.environ[NUMBA]).parent.stat().st_mode & 0o777 == 0o700
    for name in (NUMBA, MATPLOTLIB):
        monkeypatch.delenv(name)
    planted.rmdir()
    planted.symlink_to(tmp_path)
    settle(str(package))
    assert not os.environ[NUMBA].startswith(str(planted) + os.sep)


def test_who_has_a_place_keeps_it(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    settle(str(package))
    assert NUMBA not in os.environ and MATPLOTLIB not in os.environ
    assert not caplog.text and not list(home.iterdir())
    monkeypatch.setenv("HOME", str(package / "__init__.py"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    (package / "__pycache__").unlink()
    settle(str(package))
    assert NUMBA not in os.environ
    assert os.environ[MATPLOTLIB].endswith("matplotlib") and "fonts are kept in" in caplog.text


def test_the_working_folder_does_not_say_where_kernels_come_from(tmp_path: Path) -> None:
    (tmp_path / ".numba_config.yaml").write_text("cache_dir: elsewhere", encoding="utf-8")
    environment = {key: value for key, value in os.environ.items() if key != NUMBA}
    code = "import lndrl, numba; print(repr(numba.config.CACHE_DIR))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**environment, "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert (done.stdout, done.stderr) == ("''\n", "")
