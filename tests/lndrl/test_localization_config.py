"""Presets of the localization, and what its keys refuse."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lndrl.config import REPOSITORY_CONFIGS, LocalizationConfig, RunConfig, load_config
from lndrl.config.localization import PRESETS
from lndrl.errors import UserError

PAPER = REPOSITORY_CONFIGS / "paper.yaml"


def load(*overrides: str) -> RunConfig:
    return load_config(PAPER, overrides)


def test_the_default_is_the_papers() -> None:
    assert load("localization=paper").localization == LocalizationConfig()
    # What the paper leaves open, the file says as the bench reads it.
    read = {"update_ticks": [2, 3, 4], "delay": 2}
    assert load().localization == LocalizationConfig().model_copy(update=read)
    assert PRESETS["paper"] == {}


def test_a_name_stands_for_its_keys() -> None:
    best = load("localization=best").localization
    for key, value in PRESETS["best"].items():
        assert getattr(best, key) == value
    assert best.laser_max_beams == 60 and best.kind == "amcl"
    assert load("localization=perfect").localization.kind == "perfect"
    late = "localization.late_truth=true"
    told = "localization.kind=perfect"
    delays = [
        load("localization.delay=2", *more).localization.heard_delay
        for more in ((), (told,), (told, late), (late,))
    ]
    assert delays == [2, 0, 2, 2]


def test_keys_change_a_preset() -> None:
    for overrides in (
        ["localization={preset: best, laser_sigma_hit: 0.07}"],
        ["localization.preset=best", "localization.laser_sigma_hit=0.07"],
        ["localization=best", "localization.laser_sigma_hit=0.07"],
    ):
        changed = load(*overrides).localization
        assert changed.laser_sigma_hit == 0.07
        assert changed.laser_field == "surfaces"


def test_a_resolved_configuration_reads_back_equal(tmp_path: Path) -> None:
    config = load("localization=best", "localization.recovery_persistent=false")
    path = tmp_path / "resolved.yaml"
    path.write_text(config.to_yaml())
    assert load_config(path) == config
    assert config.content_hash() != load("localization=best").content_hash()


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("localization=bset", "localization: preset 'bset' is unknown; did you mean best? known: "
         "paper, best, robot, perfect"),
        ("localization={preset: ros}", "preset 'ros' is unknown; known: paper, best, robot, per"),
        ("localization.min_particles=0", "localization.min_particles = 0"),
        ("localization.max_particles=0", "greater than or equal to 1"),
        ("localization.laser_model_type=laser", "laser_model_type = 'laser'"),
        ("localization.odom_model_type=omni", "odom_model_type = 'omni'"),
        ("localization.do_beamskip=true", "do_beamskip needs laser_model_type"),
        ("localization.laser_sigma=1", "did you mean laser_sigma_hit?"),
        ("localization.odom_alpha1=.nan", "odom_alpha1"),
        ("localization={kld_z_is_probability: true, kld_z: 2.3}", "between 0.5 and 1"),
    ],
)  # fmt: skip
def test_mistakes_are_answered_in_a_sentence(override: str, sentence: str) -> None:
    with pytest.raises(UserError) as error:
        load(override)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_quantile_from_a_probability() -> None:
    assert LocalizationConfig(kld_z=0.99).kld_quantile == 0.99
    quantile = LocalizationConfig(kld_z=0.99, kld_z_is_probability=True).kld_quantile
    assert quantile == pytest.approx(2.3263, abs=1e-4)


def test_start_deviations_and_covariances() -> None:
    assert LocalizationConfig().initial_deviations == (0.05, 0.05, 0.05235987755982988)
    ros = LocalizationConfig(
        initial_cov_xx=0.25, initial_cov_yy=0.16, initial_cov_aa=(math.pi / 12) ** 2
    )
    assert ros.initial_deviations == pytest.approx((0.5, 0.4, math.pi / 12))
