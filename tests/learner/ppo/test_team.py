"""Two ranks that train together are one rank with the same batch."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import pytest
import torch
import torch.distributed as dist

from learner.ppo.batch import Batch
from learner.ppo.example.stage import stage_of
from learner.ppo.team import Team, meet_by_interface
from learner.ppo.update import PPO, DivergedError
from learner.ranks.alike import digest_of
from lndrl.errors import UserError
from tests.learner.ppo.team_cases import CASES, batches, config_of

ROOT = Path(__file__).resolve().parents[3]
LOSSES = {"policy_loss", "value_loss", "entropy", "teacher_kl"}


@contextmanager
def two_ranks() -> Iterator[Team]:
    """Rank 0 here, the other one in a process of its own."""
    wait = timedelta(seconds=120)
    store = dist.TCPStore("127.0.0.1", 0, None, True, wait, wait_for_workers=False)
    job = {"RANK": "1", "WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1"}
    job |= {"MASTER_PORT": str(store.port), "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    script = "tests.learner.ppo.other_rank"
    other = subprocess.Popen([sys.executable, "-m", script], env=job, cwd=ROOT)
    try:
        team = Team(store, 0, 2)
        try:
            yield team
        finally:
            team.close()
    finally:
        other.kill()
        other.wait()


def updated(ppo: PPO, batch: Batch) -> dict[str, float]:
    """The figures of an update; none where it diverges."""
    try:
        return ppo.update(batch, 0.1, stage_of(ppo.config, 0))
    except DivergedError:
        return {}


@pytest.fixture(scope="module")
def team() -> Iterator[Team]:
    with two_ranks() as made:
        yield made


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of rewards that are infinite
@pytest.mark.parametrize("case", CASES)
def test_two_ranks_take_the_step_that_one_takes(team: Team, case: str) -> None:
    config = config_of(case)
    team.say({"case": case})
    one, two = PPO(config), PPO(config, team=team)
    try:
        pairs = []
        for batch in batches(case):
            expected, found = (updated(ppo, batch) for ppo in (one, two))
            pairs.append((expected, found))
            words = team.gather({"figures": found, "digest": digest_of(two)})
            assert words[0] == words[1], "alike on both ranks, to the bit"
        for expected, found in pairs:
            assert expected.keys() == found.keys() and (case == "diverges") == (not found)
            for name in found.keys() & LOSSES:
                # Terms of a policy's loss are about 1 and cancel; a float32 mean has 1e-7 of them.
                assert found[name] == pytest.approx(expected[name], rel=1e-5, abs=1e-7), name
        apart = 0.1 * config.ppo.actor_learning_rate  # where a gradient is all rounding, Adam's is
        for name in ("policy", "value"):
            networks = (getattr(ppo, name).parameters() for ppo in (one, two))
            for mine, theirs in zip(*networks, strict=True):
                assert torch.allclose(mine, theirs, rtol=1e-3, atol=apart)
        order = one.rng.bit_generator.state, two.rng.bit_generator.state
        assert order[0] == order[1], "the next update draws alike, too"
    finally:
        one.close()
        two.close()


@pytest.mark.parametrize(
    ("own", "found"), [("127.0.1.1", "lo"), (OSError("unknown"), "lo"), ("192.0.2.7", None)]
)
def test_a_host_whose_name_is_its_loopback_is_met_by_the_interface(monkeypatch, own, found) -> None:
    def named(name: str) -> str:
        if isinstance(own, OSError):
            raise own
        return str(own)

    monkeypatch.setenv("GLOO_SOCKET_IFNAME", "")  # so that it comes back afterwards
    monkeypatch.delenv("GLOO_SOCKET_IFNAME")
    monkeypatch.setattr(socket, "gethostbyname", named)
    meet_by_interface("127.0.0.1")  # the one address that leads somewhere on every machine
    assert os.environ.get("GLOO_SOCKET_IFNAME") == found


def test_variables_that_describe_no_rank_are_refused(monkeypatch) -> None:
    for name, value in zip(
        ("RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT"), "22h9", strict=True
    ):
        monkeypatch.setenv(name, value)
    with pytest.raises(UserError, match=r"RANK=2, WORLD_SIZE=2, .*; start them with torchrun"):
        Team.of_environment()
    monkeypatch.setenv("RANK", "0")
    monkeypatch.setenv("WORLD_SIZE", "1")
    assert Team.of_environment() is None, "one rank is none"
    monkeypatch.delenv("MASTER_PORT")
    assert Team.of_environment() is None
