"""Actors as jobs: submitted by submitit for real, as processes of this machine."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest
import submitit
import yaml

from lndrl.errors import UserError
from lndrl.machine.processes import lives
from lndrl.placement.cluster import Cluster, load_cluster
from lndrl.placement.slurm import cancel, submit


def cluster_of(folder: Path, **part: object) -> Cluster:
    data = {
        "run": "first",
        "learner": {"host": "gpu"},
        "slurm": [{"jobs": 2, "cluster": "local", **part}],
    }
    (folder / "cluster.yaml").write_text(yaml.safe_dump(data))
    return load_cluster(folder / "cluster.yaml")


def test_jobs_start_with_the_right_command_and_end(tmp_path: Path) -> None:
    program = tmp_path / "lndrl"
    program.write_text(
        f"#!{sys.executable}\nimport os, pathlib, sys, time\n"
        f"note = pathlib.Path({str(tmp_path)!r}, f'seen-{{os.getpid()}}')\n"
        "note.write_text(' '.join(sys.argv[1:]))\n"
        "time.sleep(60)\n"
    )
    program.chmod(0o755)
    cluster = cluster_of(tmp_path, program=str(program))
    assert len(submit(cluster)) == 2 and cluster.state.exists()
    deadline = time.monotonic() + 60.0
    while len(seen := list(tmp_path.glob("seen-*"))) < 2 or not all(s.read_text() for s in seen):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    words = f"actor --connect tls/gpu:7447 --count auto --certs {cluster.certificates}"
    assert {each.read_text() for each in seen} == {words}
    assert cancel(cluster) == ["slurm: 2 jobs ended"] and not cluster.state.exists()
    pids = [int(each.name.removeprefix("seen-")) for each in seen]
    while any(map(lives, pids)):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert cancel(cluster) == []


def test_without_slurm_a_sentence_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    submitit.SlurmExecutor.affinity()
    cluster = cluster_of(tmp_path, cluster="slurm")
    with pytest.raises(UserError, match="slurm, part 0: "):
        submit(cluster)
    assert not cluster.state.exists()
