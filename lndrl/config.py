"""The whole run as frozen, validated, documented models; YAML in and out.

Every number of the paper stands here once, as a default with its source, or in ``configs/``.
"PAPER" is LNDRL (arXiv 2303.12354); "LAUNCH" is the AMCL launch file its authors published;
"GROUP" is the code of the same group.
"""

from __future__ import annotations

import difflib
import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field, model_validator

from lndrl.errors import UserError
from lndrl.models import Model, load_yaml, validate
from lndrl.scenario import Probability, Scenario

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=1)]

_HERE = Path(__file__).resolve().parent
# A wheel carries the configurations inside the package; a checkout has them beside it.
REPOSITORY_CONFIGS = _HERE / "configs" if (_HERE / "configs").is_dir() else _HERE.parent / "configs"


class LaserConfig(Model):
    """Simulated laser with the beam range finder model (PAPER, Thrun et al. §6.3)."""

    beams: Count = Field(720, description="beams over the field of view (PAPER)")
    field_of_view: Positive = Field(3.141592653589793, description="rad, first beam at -fov/2")
    range_max: Positive = Field(12.0, description="m (PAPER)")
    z_hit: Probability = Field(0.98, description="weight of a true reading (PAPER)")
    z_short: Probability = Field(0.0, description="unexpected objects; people are real (PAPER)")
    z_max: Probability = Field(0.01, description="weight of a missed echo (PAPER)")
    z_rand: Probability = Field(0.01, description="weight of a uniform reading (PAPER)")
    sigma_hit: NonNegative = Field(0.02, description="m, deviation of a true reading (PAPER)")
    lambda_short: Positive = Field(1.0, description="1/m, decay of z_short readings")

    @model_validator(mode="after")
    def _weights_sum_to_one(self) -> LaserConfig:
        total = self.z_hit + self.z_short + self.z_max + self.z_rand
        if abs(total - 1.0) > 1e-6:
            raise ValueError(f"z_hit + z_short + z_max + z_rand must be 1, not {total:g}")
        return self


class CrowdConfig(Model):
    """How pedestrians move (GROUP, parameters §4.5)."""

    max_speed: Positive = Field(0.5, description="m/s")
    orca_neighbor_distance: Positive = Field(0.5, description="m; GROUP value, last-moment push")
    orca_max_neighbors: Count = 10
    orca_time_horizon: Positive = Field(5.0, description="s")
    orca_time_horizon_obstacle: Positive = Field(5.0, description="s")
    orca_radius: Positive = Field(0.5, description="m")
    sfm_desired: NonNegative = Field(1.0, description="weight of the desired force (libpedsim)")
    sfm_social: NonNegative = Field(2.1, description="weight of the social force")
    sfm_obstacle: NonNegative = Field(1.0, description="weight of the obstacle force")
    sfm_obstacle_sigma: Positive = Field(0.8, description="m")
    sfm_radius: Positive = Field(0.2, description="m")
    sfm_lambda: Positive = 2.0
    sfm_gamma: Positive = 0.35
    sfm_n: Positive = 2.0
    sfm_n_prime: Positive = 3.0
    sfm_cutoff: Positive = Field(8.0, description="m, farther neighbours are ignored")
    see_robot: bool = Field(True, description="pedestrians avoid the robot")
    leg_radius: Positive = Field(0.10, description="m")
    leg_offset: NonNegative = Field(0.10, description="m, lateral, each side")
    step_length: Positive = Field(0.30, description="m travelled per phase of the gait")
    waypoint_radius: Positive = Field(0.2, description="m")
    model_period: Positive = Field(
        0.4,
        description="s, step of the GROUP's crowd: ORCA resolves overlaps and SFM relaxes in it",
    )


class WorldConfig(Model):
    """The true world: clock, robot, sensors, crowd."""

    tick: Positive = Field(0.1, description="s between sensor and localization updates (10 Hz)")
    ticks_per_step: Count = Field(4, description="ticks per control step: 0.4 s (GROUP)")
    robot_radius: Positive = Field(0.17, description="m (GROUP)")
    odometry_deviation: NonNegative = Field(
        0.1, description="deviation of the factor on v and on w; N(1, 0.01) is a variance (PAPER)"
    )
    laser: LaserConfig = LaserConfig()
    crowd: CrowdConfig = CrowdConfig()


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


class RewardConfig(Model):
    """The six-part reward (PAPER §III-A3)."""

    approach: float = Field(200.0, description="k_a, per metre, divided by 1 + variances")
    pose: float = Field(400.0, description="k_p, per metre or radian of pose error reduced")
    arrive: float = Field(500.0, description="r_arr")
    collide: float = Field(-800.0, description="r_col")
    lost: float = Field(-500.0, description="r_lost")
    step: float = Field(-5.0, description="r_step; '<' in the paper is a typo (parameters §6)")


class TaskConfig(Model):
    """What the robot sees, does, and is paid for."""

    linear_velocities: list[float] = Field(
        [0.0, 0.2, 0.4, 0.6], min_length=1, max_length=16, description="m/s (PAPER)"
    )
    angular_velocities: list[float] = Field(
        [-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9],
        min_length=1,
        max_length=16,
        description="rad/s (PAPER); an action is one byte on the wire",
    )
    arrive_distance: Positive = Field(0.5, description="m, estimated position to goal (PAPER)")
    lost_distance: Positive = Field(2.0, description="m, truth to estimate (PAPER)")
    lost_angle: Positive = Field(0.7853981633974483, description="rad (PAPER)")
    time_limit: Positive = Field(60.0, description="s, then truncated (parameters §4.6)")
    map_cells: Count = Field(48, description="cells per side of the pedestrian map (PAPER)")
    map_extent: Positive = Field(6.0, description="m per side (GROUP)")
    pedestrian_radius: Positive = Field(0.30, description="m, disc drawn per pedestrian (GROUP)")
    max_pedestrians: Count = Field(
        24, le=255, description="nearest people in view that are kept; one byte on the wire"
    )
    variance_limit: Positive = Field(10.0, description="variances are clipped here (§4.4)")
    reward: RewardConfig = RewardConfig()


class NetworkConfig(Model):
    """The paper's encoders, trunk and head (PAPER §III-B, pooling GROUP)."""

    pooling: Literal["max", "none"] = Field("max", description="2x2 after each map convolution")
    map_channels: tuple[int, int, int] = (64, 128, 256)
    features: Count = Field(512, description="units of map encoder, scan encoder and trunk")
    goal_features: Count = 64
    initialization: Literal["orthogonal", "default"] = Field(
        "orthogonal", description="orthogonal with a small policy head, or torch's default (GROUP)"
    )
    turn_reluctance: NonNegative = Field(
        0.0, description="the first policy's logits fall by this per rad/s; wheels slip in turns"
    )


class PPOConfig(Model):
    """Proximal policy optimization."""

    actor_learning_rate: Positive = 3e-4
    critic_learning_rate: Positive = 3e-4
    learning_rate_schedule: Literal["constant", "linear"] = "linear"
    gamma: Probability = 0.99
    gae_lambda: Probability = 0.95
    clip: Positive = 0.2
    dual_clip: float | None = Field(None, gt=1, description="lower bound for negative advantages")
    epochs: Count = 4
    batch_size: Count = Field(1024, description="samples per update, at least")
    minibatch_size: Count | None = Field(256, description="None: one full-batch step per epoch")
    entropy: NonNegative = 0.01
    value_loss: Positive = 0.5
    gradient_norm: Positive = Field(0.5, description="clip, actor and critic apart")
    joint_gradient_norm: bool = Field(False, description="one norm over both nets (GROUP)")
    normalize_advantages: bool = True
    target_kl: Positive | None = Field(None, description="stop the epochs beyond this")
    reward_scale: Positive = Field(0.01, description="factor on rewards inside the learner")
    reward_limit: Positive | None = Field(
        None, description="scaled rewards, clipped to +- this; a belief that jumps costs k_p per m"
    )
    bootstrap_truncated: bool = Field(True, description="else a timeout is an end (GROUP)")
    max_importance: Positive = Field(10.0, description="cap of the behaviour correction")
    adam_eps: Positive = 1e-5


class LearnerConfig(Model):
    """The learner service."""

    mode: Literal["async", "lockstep"] = "async"
    max_lag: Annotated[int, Field(ge=0)] = Field(8, description="older samples are dropped")
    total_steps: Count = Field(1_200_000, description="environment steps (PAPER)")
    threads: Annotated[int, Field(ge=0)] = Field(0, description="torch threads, 0: all cores")
    checkpoint_interval: Count = Field(20, description="updates between checkpoints")
    keep_checkpoints: Count = 3
    queue_chunks: Count = Field(64, description="uploads waiting at most")
    queue_megabytes: Count = Field(512, description="bytes waiting at most")


class ActorConfig(Model):
    """The actor service."""

    count: Count = Field(2, description="processes that lndrl train starts")
    worlds: Count = Field(8, description="worlds per process")
    horizon: Count = Field(64, description="steps per chunk")
    threads: Count = Field(1, description="torch threads per actor")


class TransportConfig(Model):
    """Zenoh between learner, actors and dashboards."""

    endpoint: str = Field("tcp/127.0.0.1:7447", description="loopback unless asked otherwise")
    upload_timeout: Positive = Field(20.0, description="s until an upload is sent again")
    upload_window: Count = Field(2, description="uploads in flight per actor")
    lease: Positive = Field(3.0, description="s until a silent peer counts as gone")
    max_message_megabytes: Count = 256


class RunConfig(Model):
    """Everything that decides a run; the learner hands it to the actors."""

    seed: Annotated[int, Field(ge=0)] = 1
    scenario: Scenario
    world: WorldConfig = WorldConfig()
    localization: LocalizationConfig = LocalizationConfig()
    task: TaskConfig = TaskConfig()
    network: NetworkConfig = NetworkConfig()
    ppo: PPOConfig = PPOConfig()
    learner: LearnerConfig = LearnerConfig()
    actor: ActorConfig = ActorConfig()
    transport: TransportConfig = TransportConfig()

    def to_yaml(self) -> str:
        """The resolved configuration as YAML; ``load_config`` reads it back equal."""
        return yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)

    def content_hash(self) -> str:
        """Twelve hex digits that change when any value changes."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def load_scenario(name: str, beside: Path | None = None) -> Scenario:
    """Scenario by name (``configs/scenarios/NAME.yaml``) or by path of a YAML file.

    Raises UserError naming the file and, for an unknown name, the known ones.
    """
    if name.endswith((".yaml", ".yml")):
        path = Path(name)
        if beside is not None and not path.is_absolute() and (beside / path).exists():
            path = beside / path
    else:
        folder = REPOSITORY_CONFIGS / "scenarios"
        path = folder / f"{name}.yaml"
        if not path.exists():
            known = sorted(p.stem for p in folder.glob("*.yaml"))
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {close[0]}? known" if close else "known"
            raise UserError(
                f"scenario {name!r} is unknown; {hint}: {', '.join(known)}, or give a YAML file"
            )
    return validate(Scenario, load_yaml(path), str(path))


def load_config(path: Path | str, overrides: list[str] | tuple[str, ...] = ()) -> RunConfig:
    """Configuration from YAML with ``key=value`` overrides (dotted keys, YAML values).

    Raises UserError naming file, key and mend.
    """
    path = Path(path)
    data = load_yaml(path)
    for override in overrides:
        _apply(data, override)
    where = str(path) if not overrides else f"{path} with --set"
    if isinstance(data.get("scenario"), str):
        try:
            data["scenario"] = load_scenario(data["scenario"], path.parent).model_dump()
        except UserError as error:
            raise UserError(f"{where}: {error}") from None
    elif data.get("scenario") is None:
        raise UserError(f"{where}: scenario is missing; name one, e.g. scenario: hybrid")
    return validate(RunConfig, data, where)


def parse_config(data: Any, where: str) -> RunConfig:
    """Configuration from plain data, e.g. received from a learner; raises UserError."""
    return validate(RunConfig, data, where)


def _apply(data: dict[str, Any], override: str) -> None:
    key, equals, value = override.partition("=")
    if not equals or not key:
        raise UserError(f"--set {override}: must be key=value, e.g. ppo.epochs=4")
    *parents, last = key.split(".")
    target = data
    for parent in parents:
        inner = target.setdefault(parent, {})
        if not isinstance(inner, dict):
            raise UserError(f"--set {override}: {parent} holds a value, not keys")
        target = inner
    try:
        target[last] = yaml.safe_load(value)
    except yaml.YAMLError:
        raise UserError(f"--set {override}: {value!r} is not a YAML value") from None
