"""Angles are radians; degrees are refused with what they would be."""

from __future__ import annotations

import math
from typing import Any

import pytest

from lndrl.config import CrowdConfig, LaserConfig, LocalizationConfig, TaskConfig
from lndrl.errors import UserError
from lndrl.models import Model, validate

ANGLES: list[tuple[type[Model], str]] = [
    (LaserConfig, "field_of_view"),
    (TaskConfig, "lost_angle"),
    (LocalizationConfig, "update_min_a"),
    (LocalizationConfig, "bin_angle"),
    (LocalizationConfig, "initial_deviation_yaw"),
    (CrowdConfig, "orca_veer"),
]


def refusal(model: type[Model], **data: Any) -> str:
    with pytest.raises(UserError) as caught:
        validate(model, data, "run.yaml")
    return str(caught.value)


def test_every_key_in_radians_is_an_angle() -> None:
    named = {
        (model, key)
        for model in (LaserConfig, TaskConfig, LocalizationConfig, CrowdConfig)
        for key, field in model.model_fields.items()
        if (field.description or "").split(" ")[0].rstrip(",;") == "rad"
    }
    assert named == set(ANGLES)


@pytest.mark.parametrize(("model", "key"), ANGLES)
def test_degrees_are_refused(model: type[Model], key: str) -> None:
    sentence = refusal(model, **{key: 45})
    if key != "orca_veer":  # it has a limit of its own
        assert sentence == (
            f"run.yaml: {key}: 45 is more than a turn; angles are in radians, and 45 degrees are "
            "0.7854"
        )
    assert key in sentence and refusal(model, **{key: -0.1})


def test_a_whole_turn_may_be_rounded() -> None:
    assert "360 degrees are 6.283" in refusal(LaserConfig, field_of_view=360)
    for turn in (2 * math.pi, 6.2832, 6.284):
        assert LaserConfig(field_of_view=turn).field_of_view == turn


def test_a_variance_of_degrees_is_refused() -> None:
    sentence = refusal(LocalizationConfig, initial_cov_aa=225.0)
    assert "225 is the square of more than a turn" in sentence
    assert "(15 degrees)^2 are 0.06854" in sentence
    assert LocalizationConfig(initial_cov_aa=9.0).initial_deviations[2] == 3.0


def test_minus_one_is_the_lasers_own_range_as_in_ros() -> None:
    assert LocalizationConfig(laser_max_range=-1).max_range(30.0) == 30.0
    assert LocalizationConfig(laser_max_range=8).max_range(30.0) == 8.0
    for metres in (0, -2):
        assert f"{metres} must be above 0, or -1 for the laser's own" in refusal(
            LocalizationConfig, laser_max_range=metres
        )
