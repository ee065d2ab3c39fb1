"""Ranks that were started otherwise do not begin."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from learner.ranks import agree
from learner.ranks.agree import Asked
from learner.ranks.local import LocalRanks
from lndrl.errors import UserError
from lndrl.version import VERSION
from tests.learner.helpers_learner import small_config

ROOT = Path(__file__).resolve().parents[3]
PATH = Path("runs/mine")


class Wire:
    """What rank 0 has said, and what rank 1 answers."""

    def __init__(self, rank: int) -> None:
        self.rank = rank
        self.said: dict[str, Any] = {}
        self.answer: dict[str, Any] = {}

    def say(self, word: dict[str, Any]) -> None:
        self.said = json.loads(json.dumps(word))

    def hear(self) -> dict[str, Any]:
        return self.said

    def gather(self, word: dict[str, Any]) -> list[dict[str, Any]]:
        self.answer = word
        return [{"misfit": ""}, word]

    def name(self, rank: int) -> str:
        return f"rank {rank} on there"


def said(asked: Asked, config=None) -> Wire:
    """Rank 1, once rank 0 has said what it was asked for."""
    zero, one = Wire(0), Wire(1)
    agree.lead(zero, config or asked.config or small_config(), PATH, asked)  # type: ignore[arg-type]
    one.said = zero.said
    return one


def misfit(wire: Wire, asked: Asked | None) -> str:
    with pytest.raises(UserError) as raised:
        agree.follow(wire, asked)  # type: ignore[arg-type]
    assert wire.answer["misfit"] == str(raised.value), "rank 0 says it, too"
    return str(raised.value)


def test_alike_they_take_what_rank_0_has() -> None:
    config = small_config()
    for asked in (Asked(config), None):
        agreed = agree.follow(said(Asked(config)), asked)  # type: ignore[arg-type]
        assert agreed == agree.Agreed(config, PATH)


def test_a_key_that_differs_is_named() -> None:
    wire = said(Asked(small_config()))
    text = misfit(wire, Asked(small_config(ppo={"epochs": 7})))
    assert text == (
        "ppo.epochs is 7 on rank 1 on there and 2 on rank 0; start all ranks with the same "
        "configuration"
    )


@pytest.mark.parametrize(
    ("zero", "one", "sentence"),
    [
        ({"resume": True, "run": "a"}, {}, "rank 0 was started with --resume, rank 1 on there wit"),
        ({}, {"resume": True, "run": "a"}, "rank 1 on there was started with --resume, rank 0 wit"),
        (
            {"resume": True, "run": "a"},
            {"resume": True, "run": "b"},
            "--run: rank 1 on there was started with b, rank 0 with a; start all ranks with the",
        ),
        (
            {"resume": True, "run": "a", "overrides": ("ppo.epochs=3",)},
            {"resume": True, "run": "a"},
            "--set: rank 1 on there was started with none, rank 0 with ['ppo.epochs=3']; start",
        ),
    ],
)
def test_options_that_differ_are_named(zero, one, sentence) -> None:
    def asked(given) -> Asked:
        return Asked(None if given.get("resume") else small_config(), **given)

    assert misfit(said(asked(zero)), asked(one)).startswith(sentence)


@pytest.mark.parametrize(("name", "there"), [("lndrl", "0.0.9"), ("torch", "2.0.0")])
def test_other_versions_are_refused(name: str, there: str) -> None:
    wire = said(Asked(small_config()))
    wire.said = copy.deepcopy(wire.said)
    wire.said["versions"][name] = there
    text = misfit(wire, None)
    assert text.startswith(f"rank 1 on there has {name} ")
    assert text.endswith(f", rank 0 has {there}; install the same")
    assert name != "lndrl" or VERSION in text


def test_a_rank_that_cannot_start_ends_the_job() -> None:
    with (
        pytest.raises(UserError, match=r"^rank 1 ended with exit code 2 before it had joined$"),
        LocalRanks(2, ["--no-such-option"]),
    ):
        pytest.fail("it has joined")


def test_torchrun_starts_ranks_and_lockstep_is_refused_on_all(tmp_path: Path) -> None:
    config = tmp_path / "mine.yaml"
    config.write_text(small_config(learner={"mode": "lockstep"}).to_yaml())
    command = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2", "-m", "learner"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, *command, str(config), "--run-name", "mine"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=200,
    )
    why = "learner.mode lockstep promises the same bits on every machine, and sums over ranks"
    assert f"lndrl: {why}" in done.stderr
    assert done.returncode != 0 and not (tmp_path / "runs").exists()
