"""Who is started and ended, in which order, and what is said: hosts are stand-ins without ssh."""

from __future__ import annotations

import stat
from pathlib import Path
from threading import Event
from typing import Any

import pytest
import yaml

from lndrl.errors import UserError
from lndrl.placement import launch, slurm
from lndrl.placement.cluster import Cluster, Job, load_cluster
from lndrl.transport.security.certificates import create

LISTENS = {"learner": "[listen] tls/0.0.0.0:7447", "site": "actors of this site: lndrl actor"}


class World:
    """What goes on at all hosts."""

    def __init__(self) -> None:
        self.off: set[str] = set()  # hosts
        self.mute: set[str] = set()  # jobs that never listen
        self.dying: dict[str, str] = {}  # job: its last words
        self.running: dict[str, Job] = {}
        self.done: list[str] = []
        self.looks = 0

    async def connected(self, name: str, place: Any) -> Host:
        if name in self.off:
            raise UserError(f"host {name}: no answer in time")
        return Host(self, name)


class Host:
    def __init__(self, world: World, name: str) -> None:
        self.world, self.name = world, name

    async def check(self) -> None:
        pass

    async def exists(self, path: str) -> bool:
        return False

    async def give(self, files: dict[str, Path]) -> None:
        assert all(file.exists() for file in files.values())

    async def start(self, job: Job, run: str, words: tuple[str, ...]) -> None:
        if job.name in self.world.running:
            raise UserError(f"host {self.name}: {job.name} of run {run} runs there already")
        self.world.done.append(f"start {job.name}")
        self.world.running[job.name] = job

    async def alive(self, job: Job, run: str) -> bool:
        return job.name in self.world.running and job.name not in self.world.dying

    async def log(self, job: Job, run: str) -> list[str]:
        if job.name in self.world.dying:
            return [self.world.dying[job.name]]
        self.world.done.append(f"look {job.name}")
        return [] if job.name in self.world.mute else [LISTENS[job.role]]

    async def signal(self, job: Job, run: str, number: str) -> None:
        self.world.done.append(f"end {job.name}")
        self.world.running.pop(job.name, None)

    def close(self) -> None:
        pass


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World()
    monkeypatch.setattr(launch.Host, "connected", made.connected)
    return made


def cluster_of(folder: Path, **changes: Any) -> Cluster:
    data = {
        "run": "first",
        "learner": {"host": "gpu"},
        "sites": [{"name": "lab", "host": "door"}],
        "actors": [{"host": "cpu", "site": "lab"}],
        **changes,
    }
    (folder / "cluster.yaml").write_text(yaml.safe_dump(data))
    return load_cluster(folder / "cluster.yaml")


def test_actors_start_when_their_door_is_open(tmp_path: Path, world: World) -> None:
    said: list[str] = []
    assert launch.up(cluster_of(tmp_path), True, Event(), said.append) == 0
    order = ["learner", "site-lab"]
    steps = [f"{word} {name}" for name in order for word in ("start", "look")]
    assert world.done == [*steps, "start actors-0"]
    assert said[-1].startswith("everything runs: 3 process groups on 3 hosts")


def test_a_door_that_does_not_open_ends_all(tmp_path: Path, world: World) -> None:
    world.dying["site-lab"] = "lndrl: port 7447 is in use"
    with pytest.raises(UserError, match=r"^host door: site-lab ended at once: .*7447 is in use"):
        launch.up(cluster_of(tmp_path), True, Event(), lambda line: None)
    assert "end learner" in world.done and "start actors-0" not in world.done


def test_a_door_that_stays_mute_is_given_up(
    tmp_path: Path, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(launch, "LISTENS_WITHIN", -1.0)
    world.mute = {"site-lab", "learner"}
    with pytest.raises(UserError, match=r"^host gpu: the learner does not listen after"):
        launch.up(cluster_of(tmp_path), True, Event(), lambda line: None)
    assert world.running == {}


def test_all_hosts_that_are_off_are_named(tmp_path: Path, world: World) -> None:
    world.off = {"door", "cpu"}
    with pytest.raises(UserError, match=r"host door: no answer in time; host cpu: no answer"):
        launch.up(cluster_of(tmp_path), True, Event(), lambda line: None)
    assert world.done == []


def test_a_host_that_is_off_keeps_nobody_else_running(tmp_path: Path, world: World) -> None:
    cluster = cluster_of(tmp_path)
    launch.up(cluster, True, Event(), lambda line: None)
    world.off = {"door"}
    said: list[str] = []
    with pytest.raises(UserError, match=r"host door: .*; what was started there may run on; all"):
        launch.down(cluster, said.append)
    assert list(world.running) == ["site-lab"]
    assert said == ["host cpu: actors-0 ended", "host gpu: learner ended"]


def test_a_second_up_leaves_the_first_ones_jobs_alone(
    tmp_path: Path, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster, cancelled = cluster_of(tmp_path), Event()
    launch.up(cluster, True, Event(), lambda line: None)

    def cancel(cluster: Cluster) -> list[str]:
        cancelled.set()
        return []

    monkeypatch.setattr(slurm, "cancel", cancel)
    with pytest.raises(UserError, match="learner of run first runs there already"):
        launch.up(cluster, True, Event(), lambda line: None)
    assert set(world.running) == {"learner", "site-lab", "actors-0"} and not cancelled.is_set()
    launch.down(cluster, lambda line: None)
    assert not world.running and cancelled.is_set()


def test_slurm_that_is_elsewhere_keeps_nobody_else_running(
    tmp_path: Path, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster = cluster_of(tmp_path)
    said: list[str] = []
    launch.up(cluster, True, Event(), lambda line: None)
    cluster.state.write_text('[["slurm", "slurm", ["42"]]]')
    monkeypatch.setenv("PATH", str(tmp_path))
    launch.down(cluster, said.append)
    assert not world.running
    assert said[0].startswith("slurm: job 42 cannot be ended from here (No such file or directory)")


def test_a_job_that_has_ended_long_ago_is_none_to_complain_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster = cluster_of(tmp_path)
    program = tmp_path / "scancel"
    program.write_text("#!/bin/sh\nexit 1\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    cluster.state.write_text('[["slurm", "slurm", ["42"]]]')
    assert slurm.cancel(cluster) == ["slurm: 1 job ended"] and not cluster.state.exists()


@pytest.mark.parametrize(
    ("gone", "said"),
    [
        ("ca.pem", "has no ca.pem; name a folder that lndrl certs has made"),
        ("actor.key", "has no actor.key; lndrl certs --out .* --renew actor makes one"),
        ("site.pem", "has no site.pem; lndrl certs --out .* --renew site --site-host door makes"),
        ("learner.pem", "has no learner.pem; lndrl certs .* --renew learner --host gpu makes one"),
        ("evaluator.pem", ""),
    ],
)
def test_a_certificate_that_lacks_is_named(tmp_path: Path, gone: str, said: str) -> None:
    cluster = cluster_of(tmp_path)
    create(cluster.certificates, ["gpu"], site_hosts=["door"])
    (cluster.certificates / gone).unlink()
    if said:
        with pytest.raises(UserError, match=f"first.certs: {said}"):
            launch.check_certificates(cluster, lambda line: None)
    else:  # nobody here needs it
        launch.check_certificates(cluster, lambda line: None)
