"""Which observations and which network weights are for, and how to say that in words.

What was trained under one layout means nothing under another, even where the shapes agree.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from lndrl.config import RunConfig, parse_config
from lndrl.errors import UserError
from lndrl.extensions import PartSettings
from lndrl.policy.blob import metadata_in

CONFIG_KEY = "lndrl.config"
"""Entry of a policy file's metadata that holds the configuration it was trained under, as JSON."""


def layout(config: RunConfig) -> dict[str, str]:
    """What the weights of ``config`` depend on: a noun phrase per key, e.g. ``3 scan frames``.

    Settings of a part that the network does not have are left out.
    """
    task, network, laser = config.task, config.network, config.world.laser
    facts = {
        "frames": _counted(task.scan_frames, "scan frame"),
        "network": f"network {_part(network.policy, network.policy_settings)}",
        "encoder": f"scan encoder {_part(network.scan_encoder, network.scan_encoder_settings)}",
        "beams": _counted(laser.beams, "beam"),
        "view": f"a view of {laser.field_of_view:.4g} rad",
        "range": f"a range of {laser.range_max:g} m",
        "variances": "variances" if network.variances else "no variances",
        "map": "a pedestrian map" if network.pedestrian_map else "no pedestrian map",
        "norm": "a layer norm" if network.layer_norm else "no layer norm",
        "linear": f"linear velocities {_list(sorted(task.linear_velocities))} m/s",
        "angular": f"angular velocities {_list(sorted(task.angular_velocities))} rad/s",
    }
    if network.pedestrian_map or network.scan_encoder != "fan":
        facts["features"] = f"{network.features} features"
        facts["goal"] = f"{network.goal_features} goal features"
    if network.variances:
        facts["variance_scale"] = f"variances times {network.variance_scale:g}"
        facts["variance_limit"] = f"variances up to {task.variance_limit:g}"
    if network.pedestrian_map:
        facts["cells"] = f"{task.map_cells} map cells a side"
        facts["extent"] = f"a map of {task.map_extent:g} m"
        facts["discs"] = f"pedestrians of {task.pedestrian_radius:g} m"
        facts["channels"] = f"map channels {_list(network.map_channels)}"
        facts["pooling"] = f"map pooling {network.pooling}"
        settings = network.map_encoder_settings
        facts["map_encoder"] = f"map encoder {_part(network.map_encoder, settings)}"
    return facts


def other_layout(trained: RunConfig, expected: RunConfig) -> tuple[str, str] | None:
    """How the layouts differ: phrases of ``trained`` and of ``expected``; None where equal."""
    one, two = layout(trained), layout(expected)
    # What only one of them has follows from a difference that both can name.
    keys = [key for key in one if key in two and one[key] != two[key]]
    if not keys:
        return None
    return ", ".join(one[key] for key in keys), ", ".join(two[key] for key in keys)


def check_layout(
    where: str, trained: RunConfig, expected: RunConfig, whose: str = "this configuration"
) -> None:
    """Raise UserError, naming both layouts, where weights of ``trained`` meet another one.

    ``where`` are the weights, ``whose`` is ``expected``.
    """
    difference = other_layout(trained, expected)
    if difference is not None:
        raise UserError(_sentence(where, difference, whose))


def explain_misfit(where: str, blob: bytes, expected: RunConfig) -> str | None:
    """The sentence of ``check_layout`` for a blob that says what it was trained under.

    None where it does not say, or where the layouts are equal.
    """
    trained = _config_inside(blob)
    difference = other_layout(trained, expected) if trained else None
    return _sentence(where, difference, "this configuration") if difference else None


def _sentence(where: str, difference: tuple[str, str], whose: str) -> str:
    return f"{where}: trained with {difference[0]}; {whose} has {difference[1]}"


def _config_inside(blob: bytes) -> RunConfig | None:
    """The configuration in the head of a safetensors blob."""
    try:
        return parse_config(json.loads(metadata_in(blob)[CONFIG_KEY]), "weights")
    except (ValueError, KeyError, TypeError, RecursionError, UserError):
        return None


def _part(name: str, settings: PartSettings) -> str:
    return f"{name} of {json.dumps(settings, sort_keys=True)}" if settings else name


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
