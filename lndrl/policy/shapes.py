"""Names and shapes of the built-in policy's parameters, by the configuration alone."""

from __future__ import annotations

from lndrl.config import RunConfig
from lndrl.navigation import action_table
from lndrl.policy.arrays import pooling_factor
from lndrl.policy.sparse import LEVELS

Shapes = dict[str, tuple[int, ...]]

SCAN_CHANNELS = 32
"""Of both convolutions of either scan encoder."""
FAN_SCAN_FEATURES = 256
FAN_TRUNK_FEATURES = 128
"""Units of DRL_laser's layers (KNOWN, parameters §7.1)."""


def parameter_shapes(config: RunConfig) -> Shapes:
    """Shape of every tensor of ``networks.build_policy(config)``, whose parts are all built in."""
    network, fan = config.network, config.network.scan_encoder == "fan"
    plain = has_plain_goal(config)
    goals, outputs = goal_floats(config), len(action_table(config.task))
    shapes: Shapes = {}

    def add(name: str, outputs: int, *inputs: int) -> None:
        shapes[f"{name}.weight"], shapes[f"{name}.bias"] = (outputs, *inputs), (outputs,)

    joined = 0
    if network.pedestrian_map:
        first, second, third = network.map_channels
        add("map_encoder.conv1", first, 3, 3, 3)
        add("map_encoder.conv2", second, first, 3, 3)
        add("map_encoder.conv3", third, second, 3, 3)
        cells = last_cells(config) ** 2
        shapes["map_encoder.linear.weight"] = (cells, network.features, third)
        shapes["map_encoder.linear.bias"] = (network.features,)
        joined += network.features
    beams, channels = config.world.laser.beams, SCAN_CHANNELS
    features = FAN_SCAN_FEATURES if fan else network.features
    add("scan_encoder.conv1", channels, config.task.scan_frames if fan else 1, 5)
    add("scan_encoder.conv2", channels, channels, 3)
    positions = fan_positions(beams) if fan else scan_positions(beams)
    add("scan_encoder.linear", features, channels * positions)
    if not plain:
        add("goal_encoder", network.goal_features, goals)
    joined += features + (goals if plain else network.goal_features)
    trunk = FAN_TRUNK_FEATURES if plain else network.features
    add("trunk", trunk, joined)
    if network.layer_norm:
        add("norm", trunk)
    add("head", outputs, trunk)
    return shapes


def has_plain_goal(config: RunConfig) -> bool:
    """Whether the trunk reads the goal itself: without a map Fan's network is his whole one."""
    return config.network.scan_encoder == "fan" and not config.network.pedestrian_map


def goal_floats(config: RunConfig) -> int:
    """How many of an observation's six goal floats the network reads."""
    return 6 if config.network.variances else 3


def last_cells(config: RunConfig) -> int:
    """Cells per side of the map encoder's last map."""
    return config.task.map_cells // pooling_factor(config) ** LEVELS


def scan_positions(beams: int) -> int:
    """Outputs per channel of the scan encoder's convolutions: 5 taps by 3, then 3 by 2."""
    return ((beams - 5) // 3 + 1 - 3) // 2 + 1


def fan_positions(beams: int) -> int:
    """The same of Fan's, both by 2 with one zero on either side."""
    return (((beams - 3) // 2 + 1) - 1) // 2 + 1
