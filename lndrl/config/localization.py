"""The belief: AMCL under ROS parameter names."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from lndrl.models import Count, Model, NonNegative, Positive, Probability


class LocalizationConfig(Model):
    """AMCL under ROS parameter names, the paper's own launch file as defaults (LAUNCH)."""

    kind: Literal["amcl", "perfect"] = Field("amcl", description="perfect hands out the truth")
    min_particles: Count = 500
    max_particles: Count = 2000
    kld_err: Positive = 0.05
    kld_z: Positive = Field(0.99, description="used directly as the normal quantile, like ROS")
    odom_alpha1: NonNegative = Field(0.2, description="rotation noise from rotation")
    odom_alpha2: NonNegative = Field(0.2, description="rotation noise from translation")
    odom_alpha3: NonNegative = Field(0.2, description="translation noise from translation")
    odom_alpha4: NonNegative = Field(0.2, description="translation noise from rotation")
    laser_max_beams: Count = 60
    laser_max_range: Positive = Field(12.0, description="m; readings at or beyond are skipped")
    laser_z_hit: Probability = 0.95
    laser_z_rand: Probability = 0.05
    laser_sigma_hit: Positive = Field(0.2, description="m")
    laser_likelihood_max_dist: Positive = Field(2.0, description="m")
    update_min_d: NonNegative = Field(0.01, description="m, tested on |dx| or |dy| of odometry")
    update_min_a: NonNegative = Field(0.001, description="rad")
    resample_interval: Count = 1
    recovery_alpha_slow: Probability = 0.001
    recovery_alpha_fast: Probability = 0.1
    bin_size: Positive = Field(0.5, description="m, KLD and cluster bins")
    bin_angle: Positive = Field(0.17453292519943295, description="rad (10 degrees)")
    initial_deviation_xy: NonNegative = Field(0.05, description="m, at episode start")
    initial_deviation_yaw: NonNegative = Field(0.05235987755982988, description="rad (3 degrees)")

    @model_validator(mode="after")
    def _order(self) -> LocalizationConfig:
        if self.min_particles > self.max_particles:
            raise ValueError("min_particles must not exceed max_particles")
        return self
