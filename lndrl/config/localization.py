"""The belief: AMCL under ROS parameter names, and settings that are known by a name."""

from __future__ import annotations

import difflib
import math
from statistics import NormalDist
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from lndrl.models import (
    LATER,
    Angle,
    AngleVariance,
    Count,
    Later,
    Model,
    NonNegative,
    Positive,
    PositiveAngle,
    Probability,
    as_recorded,
)

_OWN_RANGE = -1.0

PRESETS: dict[str, dict[str, Any]] = {
    # The defaults below: the paper's launch file, with ROS's own habits.
    "paper": {},
    # The most accurate and robust of what was tried; docs/localization.md has the figures.
    "best": {
        "odom_model_type": "diff-corrected",
        "odom_alpha1": 0.1,
        "odom_alpha2": 0.1,
        "odom_alpha3": 0.1,
        "odom_alpha4": 0.1,
        "laser_model_type": "likelihood_field_prob",
        "laser_field": "surfaces",
        "laser_sigma_hit": 0.1,
        "do_beamskip": True,  # people must not set off the recovery
        "resample_model_type": "systematic",
        "recovery_persistent": True,
        "recovery_tolerance": 5.0,
        "kld_one_bin": "min",
        "update_at_start": False,
    },
    # For real scanners, whose beams err together; chosen on logs of real buildings (same page).
    "robot": {
        "min_particles": 1000,
        "odom_model_type": "diff-corrected",
        "odom_alpha1": 0.05,
        "odom_alpha2": 0.02,
        "odom_alpha3": 0.02,
        "odom_alpha4": 0.02,
        "laser_model_type": "likelihood_field_prob",
        "laser_field": "surfaces",
        "laser_likelihood_exponent": 0.2,
        "laser_sigma_hit": 0.1,
        "laser_z_hit": 0.8,
        "laser_z_rand": 0.2,
        "do_beamskip": True,
        "resample_model_type": "systematic",
        "recovery_persistent": True,
        "recovery_tolerance": 1.3,  # of factors to the power of 0.2: as 3.7 would be
        "kld_one_bin": "min",
        "update_at_start": False,
    },
    "perfect": {"kind": "perfect"},
}


def _range_or_own(metres: float) -> float:
    if metres <= 0.0 and metres != _OWN_RANGE:
        raise ValueError(f"{metres:g} must be above 0, or -1 for the laser's own range")
    return metres


class LocalizationConfig(Model):
    """AMCL under ROS parameter names, the paper's own launch file as defaults (LAUNCH).

    In YAML either a preset's name (``localization: best``) or keys, of which ``preset`` names the
    settings that the others change.
    """

    preset: Literal["paper", "best", "robot", "perfect"] = Field(
        "paper", description="paper, best, robot, perfect: values of the keys that are not named"
    )
    kind: Literal["amcl", "perfect"] = Field("amcl", description="perfect hands out the truth")
    min_particles: Count = Field(500, description="fewest that are resampled (LAUNCH)")
    max_particles: Count = Field(
        2000, description="most that are resampled; all are drawn where an episode starts (LAUNCH)"
    )
    kld_err: Positive = Field(
        0.05, description="error of the drawn distribution that the KLD bound allows (LAUNCH)"
    )
    kld_z: Positive = Field(0.99, description="used directly as the normal quantile, like ROS")
    kld_z_is_probability: bool = Field(
        False, description="kld_z is the probability instead: 0.99 becomes the quantile 2.326"
    )
    kld_one_bin: Annotated[Literal["max", "min"], Later("min")] = Field(
        "max",
        description="particles asked for while all lie in one bin: max_particles, as ROS has it, "
        "or min_particles, which costs less and keeps the count, so the recovery, calm",
    )
    odom_model_type: Literal["diff", "diff-corrected"] = Field(
        "diff", description="diff uses variances as deviations, like ROS; diff-corrected does not"
    )
    odom_alpha1: NonNegative = Field(0.2, description="rotation noise from rotation")
    odom_alpha2: NonNegative = Field(0.2, description="rotation noise from translation")
    odom_alpha3: NonNegative = Field(0.2, description="translation noise from translation")
    odom_alpha4: NonNegative = Field(0.2, description="translation noise from rotation")
    laser_model_type: Literal["likelihood_field", "likelihood_field_prob", "beam"] = Field(
        "likelihood_field", description="beam casts a ray per particle and beam: slow"
    )
    laser_field: Literal["solid", "boundaries", "surfaces"] = Field(
        "solid",
        description="distance 0 all inside obstacles (ROS), in their boundary cells, or at the "
        "very edge of free cells",
    )
    laser_likelihood_exponent: Positive = Field(
        1.0, description="of a beam's factor in likelihood_field_prob; below 1: beams err together"
    )
    laser_max_beams: Count = Field(60, description="beams of a scan that are used (LAUNCH)")
    laser_max_range: Annotated[float, AfterValidator(_range_or_own)] = Field(
        12.0, description="m; readings at or beyond are skipped; -1: the laser's own, as in ROS"
    )
    laser_min_range: Annotated[float, AfterValidator(_range_or_own), LATER] = Field(
        -1.0,
        description="m; readings at or below are no echo; -1: the scanner's own, as in ROS; the "
        "simulated laser has none",
    )
    laser_z_hit: Probability = Field(0.95, description="weight of readings of the map (LAUNCH)")
    laser_z_short: Probability = Field(
        0.1, description="weight of readings before the map's, beam model only (LAUNCH)"
    )
    laser_z_max: Probability = Field(
        0.05, description="weight of missed echoes, beam model only (LAUNCH)"
    )
    laser_z_rand: Probability = Field(0.05, description="weight of random readings (LAUNCH)")
    laser_sigma_hit: Positive = Field(0.2, description="m, deviation of readings (LAUNCH)")
    laser_lambda_short: Positive = Field(
        0.1, description="1/m, decay of z_short, beam model only (LAUNCH)"
    )
    laser_likelihood_max_dist: Positive = Field(
        2.0, description="m from an obstacle beyond which all is equally unlikely (LAUNCH)"
    )
    do_beamskip: bool = Field(
        False, description="likelihood_field_prob: leave out beams that few particles explain"
    )
    beam_skip_distance: Positive = Field(
        0.5, description="m from an obstacle within which a particle explains a beam"
    )
    beam_skip_threshold: Probability = Field(0.3, description="share of particles that explain it")
    beam_skip_error_threshold: Probability = Field(
        0.9, description="this share of the beams skipped, and all are used: probably misplaced"
    )
    update_min_d: NonNegative = Field(
        0.01, description="m of odometry in x or y, else no update (LAUNCH)"
    )
    update_min_a: Angle = Field(0.001, description="rad of odometry, else no update (LAUNCH)")
    update_at_start: Annotated[bool, Later(False)] = Field(
        True,
        description="weigh and resample by the first scan after a reset though nothing has moved "
        "yet, as ROS does",
    )
    update_ticks: Annotated[list[Count] | None, LATER] = Field(
        None,
        description="ticks of a control step after which the filter hears odometry and laser, from "
        "1 to world.ticks_per_step, which is among them, e.g. [2, 4]. Default: after every tick",
    )
    resample_interval: Count = Field(1, description="updates per resampling (LAUNCH)")
    resample_model_type: Literal["multinomial", "systematic"] = Field(
        "multinomial", description="independent draws, or evenly spread ones"
    )
    selective_resampling: bool = Field(
        False, description="resample only when the effective count is below half"
    )
    recovery_alpha_slow: Probability = Field(
        0.001,
        description="share of the newest weight in the slow average; both 0: no recovery (LAUNCH)",
    )
    recovery_alpha_fast: Probability = Field(
        0.1,
        description="share of the newest weight in the fast average; the more it falls below the "
        "slow one, the more particles are drawn anywhere (LAUNCH)",
    )
    recovery_persistent: bool = Field(
        False, description="inject until the scan fits again (Thrun); ROS forgets after one burst"
    )
    recovery_tolerance: Positive = Field(
        1.0, description="persistent only: injects when the fit is this many times worse than usual"
    )
    bin_size: Positive = Field(0.5, description="m, side of the bins of KLD and clusters (ROS)")
    bin_angle: PositiveAngle = Field(
        0.17453292519943295, description="rad, the bins' third side, 10 degrees (ROS)"
    )
    initial_deviation_xy: NonNegative = Field(
        0.05, description="m, of x and y at episode start (ours)"
    )
    initial_deviation_yaw: Angle = Field(
        0.05235987755982988, description="rad at episode start, 3 degrees (ours)"
    )
    initial_cov_xx: NonNegative | None = Field(
        None, description="m^2, replaces the deviation; 0.25 in ROS"
    )
    initial_cov_yy: NonNegative | None = Field(
        None, description="m^2, replaces the deviation; 0.25 in ROS"
    )
    initial_cov_aa: AngleVariance | None = Field(
        None, description="rad^2, replaces the deviation; (pi/12)^2 in ROS"
    )
    delay: Annotated[int, Field(ge=0, le=50)] = Field(
        0, description="control steps by which the pose and variances that the robot hears are old"
    )
    late_truth: Annotated[bool, LATER] = Field(
        False,
        description="with kind perfect: the truth is heard late, too, by delay; else at once",
    )
    agreement_distance: Positive = Field(
        0.2, description="m from an obstacle within which a beam agrees with the estimate"
    )

    @model_validator(mode="before")
    @classmethod
    def _resolve(cls, data: Any) -> Any:
        """A preset's name, alone or as key, to the keys that it stands for."""
        data = as_recorded(cls, data)
        if isinstance(data, str):
            data = {"preset": data}
        if not isinstance(data, dict) or not isinstance(data.get("preset"), str):
            return data
        name = data["preset"]
        if name not in PRESETS:
            close = difflib.get_close_matches(name, PRESETS, n=1)
            hint = f"did you mean {close[0]}? known" if close else "known"
            raise ValueError(f"preset {name!r} is unknown; {hint}: {', '.join(PRESETS)}")
        return {**PRESETS[name], **data}

    @model_validator(mode="after")
    def _order(self) -> LocalizationConfig:
        ticks = self.update_ticks
        if ticks is not None and (not ticks or ticks != sorted(set(ticks))):
            raise ValueError(f"update_ticks {ticks} must name ticks in ascending order, each once")
        if self.min_particles > self.max_particles:
            raise ValueError("min_particles must not exceed max_particles")
        if self.kld_z_is_probability and not 0.5 < self.kld_z < 1.0:
            raise ValueError(
                f"kld_z must lie between 0.5 and 1 as a probability, not at {self.kld_z:g}"
            )
        if self.do_beamskip and self.laser_model_type != "likelihood_field_prob":
            raise ValueError(
                "do_beamskip needs laser_model_type likelihood_field_prob, "
                f"not {self.laser_model_type}"
            )
        return self

    @property
    def heard_delay(self) -> int:
        """Control steps by which the pose is old that the robot hears."""
        late = self.kind != "perfect" or self.late_truth
        return self.delay if late else 0

    @property
    def kld_quantile(self) -> float:
        """The normal quantile in the KLD bound."""
        return NormalDist().inv_cdf(self.kld_z) if self.kld_z_is_probability else self.kld_z

    def max_range(self, laser_range: float) -> float:
        """Metres at and beyond which a reading is none, with a laser that sees ``laser_range``."""
        if self.laser_max_range == _OWN_RANGE:
            return laser_range
        return min(self.laser_max_range, laser_range)

    def min_range(self, laser_range: float) -> float:
        """Metres at and below which a reading is none, with a scanner that says ``laser_range``.

        Negative where there is no such range.
        """
        return max(self.laser_min_range, laser_range)

    @property
    def initial_deviations(self) -> tuple[float, float, float]:
        """Deviations of x, y (m) and yaw (rad) of the cloud that an episode starts with."""
        pairs = (
            (self.initial_cov_xx, self.initial_deviation_xy),
            (self.initial_cov_yy, self.initial_deviation_xy),
            (self.initial_cov_aa, self.initial_deviation_yaw),
        )
        x, y, yaw = (
            float(deviation) if variance is None else math.sqrt(variance)
            for variance, deviation in pairs
        )
        return x, y, yaw
