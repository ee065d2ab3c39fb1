"""What whoever waits compiles ahead: all that is missing, what others will use, nothing twice."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lndrl import ahead
from lndrl.config import find, load_config
from lndrl.kernels import is_kept

ROOT = Path(ahead.__file__).resolve().parents[1]
WORK = (ahead._localize, ahead._teach, ahead._learn, ahead._step)


def test_what_is_missing_is_done_once_and_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    config = load_config(find("configuration", "lndrl"))
    kept: set[str] = set()
    monkeypatch.setattr(ahead, "is_kept", lambda module, name: name in kept)
    assert ahead._missing(config, training=True) == list(WORK)
    assert ahead._missing(config, training=False) == [ahead._localize, ahead._step]
    kept |= {"update_belief", "decide", "judge_worlds"}
    assert ahead._missing(config, training=True) == [ahead._learn, ahead._step]
    kept |= {"drive_worlds", "windows_gradient"}
    assert ahead._missing(config, training=True) == []


def test_all_of_it_works_and_is_kept() -> None:
    config = load_config(find("configuration", "lndrl"), ["localization.max_particles=600"])
    for each in WORK:
        each(config)
    assert ahead._missing(config, training=True) == []
    assert not is_kept("lndrl.navigation.step", "drive_world")


def test_a_program_ends_while_it_compiles(tmp_path: Path) -> None:
    """Nobody waits for a kernel that nobody needs any more."""
    script = (
        "from lndrl.config import find, load_config\n"
        "from lndrl.ahead import compiling_ahead\n"
        "import time\n"
        "with compiling_ahead(load_config(find('configuration', 'lndrl'))):\n"
        "    time.sleep(3.0)\n"
        "print('done', flush=True)\n"
    )
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True, text=True, encoding="utf-8", timeout=300,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr
    assert "Traceback" not in done.stderr and time.monotonic() - began < 60.0
