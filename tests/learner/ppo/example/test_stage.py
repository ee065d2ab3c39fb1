"""The phases of a run with a teacher, as a function of its steps."""

from __future__ import annotations

import pytest

from learner.ppo.example.stage import Stage, stage_of
from lndrl.policy import Guidance
from lndrl.transport.status import GUIDED, IMITATION, REINFORCEMENT
from tests.learner.helpers_learner import small_config

PLAN = {
    "steps": 1000,
    "drive_steps": 400,
    "temperature": 0.4,
    "final_temperature": 0.1,
    "kl": 2.0,
    "kl_steps": 500,
}


def taught(**plan):
    return small_config(ppo={"teacher": "predictive"}, imitation={**PLAN, **plan})


def test_without_a_teacher_there_is_only_reinforcement() -> None:
    assert stage_of(small_config(imitation=PLAN), 0) == Stage()
    assert Stage().guidance == Guidance()


@pytest.mark.parametrize(
    ("steps", "phase", "temperature", "kl", "drives", "until"),
    [
        (0, IMITATION, 0.4, 0.0, 1.0, 1000),
        (200, IMITATION, 0.34, 0.0, 0.5, 1000),
        (400, IMITATION, 0.28, 0.0, 0.0, 1000),
        (999, IMITATION, 0.1003, 0.0, 0.0, 1000),
        (1000, GUIDED, 0.1, 2.0, 0.0, 1500),
        (1250, GUIDED, 0.1, 1.0, 0.0, 1500),
        (1500, REINFORCEMENT, 0.1, 0.0, 0.0, None),
        (10**9, REINFORCEMENT, 0.1, 0.0, 0.0, None),
    ],
)
def test_phases_follow_one_another(steps, phase, temperature, kl, drives, until) -> None:
    stage = stage_of(taught(), steps)
    assert (stage.phase, stage.until) == (phase, until)
    assert stage.temperature == pytest.approx(temperature)
    assert (stage.kl, stage.drives) == pytest.approx((kl, drives))
    assert stage.guidance == Guidance(phase != REINFORCEMENT, stage.drives)


def test_phases_can_be_left_out() -> None:
    assert stage_of(taught(kl=0.0), 1000).phase == REINFORCEMENT
    assert stage_of(taught(kl_steps=0), 1000).phase == REINFORCEMENT
    assert stage_of(taught(drive_steps=0), 0).drives == 0.0


def test_whoever_avoids_is_labelled_to_the_end() -> None:
    avoiding = taught(avoid=2.0)
    assert stage_of(avoiding, 0) == stage_of(taught(), 0)
    for steps in (1000, 1250, 10**9):
        stage = stage_of(avoiding, steps)
        assert stage.avoids and stage.guidance == Guidance(labels=True, drives=0.0)
        assert not stage_of(taught(), steps).avoids


def test_each_says_what_begins() -> None:
    words = [stage_of(taught(), steps).words(taught()) for steps in (0, 1000, 2000)]
    assert words == [
        "imitation of predictive until step 1,000",
        "PPO, held to predictive by a divergence that fades until step 1,500",
        "PPO",
    ]
