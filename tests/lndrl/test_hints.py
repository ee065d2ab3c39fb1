"""A hint names what was meant, and never a key of another meaning."""

from __future__ import annotations

from typing import Any

import pytest

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.errors import UserError
from lndrl.hints import meant_key
from lndrl.models import _vocabulary, validate

BASE = load_config(REPOSITORY_CONFIGS / "lndrl.yaml").model_dump(mode="json")


def said(section: str, key: str) -> str:
    data: dict[str, Any] = {**BASE, section: {**BASE[section], key: 1}}
    with pytest.raises(UserError) as caught:
        validate(RunConfig, data, "run.yaml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("section", "key", "meant"),
    [
        ("localization", "laser_max_rnage", "laser_max_range"),
        ("localization", "min_particle", "min_particles"),
        ("localization", "max_laser_range", "laser_max_range"),  # in another order
        ("localization", "maxparticles", "max_particles"),
        ("localization", "alpha1", "odom_alpha1"),  # as nav2 calls it
        ("localization", "sigma_hit", "laser_sigma_hit"),
        ("localization", "recovery_alpha_fsat", "recovery_alpha_fast"),
        ("task", "lost_angel", "lost_angle"),
        ("task", "linear_velocity", "linear_velocities"),
        ("ppo", "entorpy", "entropy"),
        ("ppo", "epoch", "epochs"),
    ],
)
def test_a_slip_is_understood(section: str, key: str, meant: str) -> None:
    assert said(section, key) == f"run.yaml: unknown key {section}.{key}; did you mean {meant}?"


@pytest.mark.parametrize(
    ("section", "key", "other"),
    [
        ("localization", "laser_mean_range", "laser_max_range"),
        ("localization", "odom_alpha5", "odom_alpha1"),
        ("localization", "update_min_t", "update_min_d"),
        ("localization", "initial_cov_xy", "initial_cov_xx"),
        ("localization", "laser_z_mid", "laser_z_hit"),
        ("localization", "resample_model_interval", "resample_interval"),
        ("task", "arrive_angle", "lost_angle"),
        ("ppo", "target_clip", "target_kl"),
        ("ppo", "scale", "reward_scale"),
        ("learner", "max_steps", "total_steps"),
    ],
)
def test_another_meaning_is_not_suggested(section: str, key: str, other: str) -> None:
    sentence = said(section, key)
    assert f"did you mean {other}?" not in sentence
    assert "known: " in sentence and other in sentence


def test_words_of_other_keys_are_no_slips() -> None:
    assert {"speed", "min", "max", "seed"} <= _vocabulary()
    assert meant_key("speed", ["seed", "scenario"], _vocabulary()) is None
    assert meant_key("sede", ["seed", "scenario"], _vocabulary()) == "seed"
    assert meant_key("rate", ["learning_rate", "critic_learning_rate"], set()) is None
