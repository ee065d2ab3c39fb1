"""Two ranks that train together are one rank with the same batch."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import pytest
import torch
import torch.distributed as dist

from learner.ppo.example.stage import stage_of
from learner.ppo.team import Team
from learner.ppo.update import PPO, DivergedError
from learner.ranks.alike import digest_of
from lndrl.errors import UserError
from tests.learner.ppo.team_cases import CASES, batches, config_of

ROOT = Path(__file__).resolve().parents[3]
LOSSES = ("policy_loss", "value_loss", "entropy", "teacher_kl")


@contextmanager
def two_ranks(*arguments: str) -> Iterator[Team]:
    """Rank 0 here, the other one in a process of its own."""
    wait = timedelta(seconds=120)
    store = dist.TCPStore("127.0.0.1", 0, None, True, wait, wait_for_workers=False)
    job = {"RANK": "1", "WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1"}
    job |= {"MASTER_PORT": str(store.port), "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    script = "tests.learner.ppo.other_rank"
    other = subprocess.Popen([sys.executable, "-m", script, *arguments], env=job, cwd=ROOT)
    try:
        team = Team(store, 0, 2)
        try:
            yield team
        finally:
            team.close()
        assert other.wait(60.0) == 0
    finally:
        other.kill()
        other.wait()


@pytest.fixture(scope="module")
def team() -> Iterator[Team]:
    with two_ranks() as made:
        yield made
        made.say({"case": None})


@pytest.mark.parametrize("case", CASES)
def test_two_ranks_take_the_step_that_one_takes(team: Team, case: str) -> None:
    config = config_of(case)
    team.say({"case": case})
    one, two = PPO(config), PPO(config, team=team)
    try:
        for batch in batches(case):
            try:
                expected = one.update(batch, 0.1, stage_of(config, 0))
                found = two.update(batch, 0.1, stage_of(config, 0))
            except DivergedError:
                assert case == "diverges"
                with pytest.raises(DivergedError):
                    two.update(batch, 0.1, stage_of(config, 0))
                found, expected = {}, {}
            words = team.gather({"figures": found, "digest": digest_of(two)})
            assert words[0] == words[1], "alike on both ranks, to the bit"
            for name in LOSSES:
                assert found.get(name) == pytest.approx(expected.get(name), rel=1e-5), name
            assert found.get("gradient_norm_value") == pytest.approx(
                expected.get("gradient_norm_value"), rel=1e-4
            )
        for network in ("policy", "value"):
            pairs = zip(
                getattr(one, network).parameters(), getattr(two, network).parameters(), strict=True
            )
            assert all(torch.allclose(a, b, rtol=1e-3, atol=3e-5) for a, b in pairs)
        assert (case == "diverges") == (found == {})
        order = one.rng.bit_generator.state, two.rng.bit_generator.state
        assert order[0] == order[1], "the next update draws alike, too"
    finally:
        one.close()
        two.close()


def test_who_is_gone_is_named() -> None:
    with pytest.raises(UserError, match=r"^rank 1 on \S+ is gone; the job ends here; what is"):  # noqa: SIM117
        with two_ranks("dies") as team:
            for _ in range(3):
                team.gather({})


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
