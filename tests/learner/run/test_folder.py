"""A run's folder: one learner at a time, whatever became of the one before."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import pytest

from learner.learner import Learner
from learner.run.folder import RunFolder
from lndrl.errors import UserError
from lndrl.machine import lock as locks
from lndrl.transport import MemoryNetwork
from tests.learner.helpers_learner import small_config


def learner(path: Path, resume: bool = False, **changes: object) -> Learner:
    network = MemoryNetwork()
    made = Learner(small_config(**changes), path, network.learner(), resume=resume, quiet=True)
    made.begin()
    return made


def test_a_second_learner_is_refused_and_touches_nothing(tmp_path: Path) -> None:
    first = learner(tmp_path / "run")
    partial = tmp_path / "run/checkpoints/.step-000000032.partial"
    partial.mkdir()  # the first one is writing a checkpoint
    kept = (tmp_path / "run/config.yaml").read_text()
    with pytest.raises(UserError, match=f"a learner is still at work there, process {os.getpid()}"):
        learner(tmp_path / "run", resume=True, seed=9)
    assert partial.is_dir() and (tmp_path / "run/config.yaml").read_text() == kept
    first.close()
    learner(tmp_path / "run", resume=True).close()
    assert not partial.exists()


def test_a_learner_that_cannot_resume_lets_the_next_one_in(tmp_path: Path) -> None:
    learner(tmp_path / "run").close()
    (checkpoint,) = (tmp_path / "run/checkpoints").iterdir()
    aside = checkpoint.rename(tmp_path / checkpoint.name)
    with pytest.raises(UserError, match="holds no checkpoint") as refused:
        learner(tmp_path / "run", resume=True)
    shutil.move(aside, checkpoint)
    learner(tmp_path / "run", resume=True).close()
    assert refused.value  # while its frames are alive


def test_what_is_no_run_gets_no_lock(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is no run folder of lndrl"):
        RunFolder.open(tmp_path)
    assert not list(tmp_path.iterdir())
    (tmp_path / "run.json").write_text("{}")
    for _ in range(2):
        with pytest.raises(UserError, match="is no run folder of lndrl"):
            RunFolder.open(tmp_path)


def test_a_file_system_without_locks_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(locks.fcntl, "flock", none)
    learner(tmp_path / "run").close()
    events = (tmp_path / "run/events.log").read_text()
    assert "cannot be locked (No locks available): let no other learner in" in events
