"""The whole run as frozen, validated, documented models; YAML in and out.

Every number of the paper stands here once, as a default with its source, or in ``configs/``.
``keys.SOURCES`` says what its sources are called.
"""

from lndrl.config.imitation import ImitationConfig
from lndrl.config.keys import SOURCES, Key, differences, find_keys, flatten, keys
from lndrl.config.learning import (
    MOST_ACTORS,
    MOST_WORLDS_PER_ACTOR,
    ActorConfig,
    LearnerConfig,
    NetworkConfig,
    PPOConfig,
    TransportConfig,
)
from lndrl.config.localization import LocalizationConfig
from lndrl.config.run import (
    FIXED_ACTORS,
    RunConfig,
    load_config,
    load_scenario,
    parse_config,
)
from lndrl.config.shipped import DEFAULTS, REPOSITORY_CONFIGS, Kind, find, shipped
from lndrl.config.task import RewardConfig, RewardTerm, TaskConfig
from lndrl.config.world import (
    AccelerationConfig,
    CrowdConfig,
    LaserConfig,
    RandomizeConfig,
    ReplicaConfig,
    RetryConfig,
    RobotConfig,
    WorldConfig,
)

__all__ = [
    "DEFAULTS",
    "FIXED_ACTORS",
    "MOST_ACTORS",
    "MOST_WORLDS_PER_ACTOR",
    "REPOSITORY_CONFIGS",
    "SOURCES",
    "AccelerationConfig",
    "ActorConfig",
    "CrowdConfig",
    "ImitationConfig",
    "Key",
    "Kind",
    "LaserConfig",
    "LearnerConfig",
    "LocalizationConfig",
    "NetworkConfig",
    "PPOConfig",
    "RewardConfig",
    "RewardTerm",
    "RobotConfig",
    "RunConfig",
    "TaskConfig",
    "TransportConfig",
    "RandomizeConfig",
    "ReplicaConfig",
    "RetryConfig",
    "WorldConfig",
    "differences",
    "find",
    "find_keys",
    "flatten",
    "keys",
    "load_config",
    "load_scenario",
    "parse_config",
    "shipped",
]
