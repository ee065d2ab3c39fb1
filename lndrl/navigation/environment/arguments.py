"""What users hand to the environments: configurations, numbers, options; wrong ones are refused."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec
from pydantic import BaseModel

from lndrl.config import RunConfig, load_config, load_scenario, parse_config

Configuration = RunConfig | Mapping[str, Any] | Path | str

LARGEST = 2**53 - 1
"""Of world ids and episode numbers: what a record of an episode can hold."""


def run_config(config: Configuration | None, scenario: Path | str | None) -> RunConfig:
    """The configuration that is meant.

    ``config`` is a RunConfig, keys and values, or a YAML file; ``scenario``, a name or a YAML file,
    takes the place of its scenario. Without ``config`` all defaults, in ``scenario`` or hybrid.
    Raises UserError for a wrong file, key or name, ValueError for another type.
    """
    if isinstance(scenario, Path):
        scenario = str(scenario)
    if scenario is not None and (not isinstance(scenario, str) or not scenario):
        raise ValueError(f"scenario must be a name or a YAML file, not {scenario!r}")
    if config is None:
        return RunConfig(scenario=load_scenario("hybrid" if scenario is None else scenario))
    if isinstance(config, Mapping):
        config = _from_keys(dict(config), scenario)
    elif isinstance(config, Path | str):
        config = load_config(config)
    if not isinstance(config, RunConfig):
        raise ValueError(
            f"config must be a RunConfig, keys and values, or a YAML file, not {config!r}"
        )
    if scenario is None:
        return config
    return config.model_copy(update={"scenario": load_scenario(scenario)})


def _from_keys(keys: dict[str, Any], scenario: str | None) -> RunConfig:
    named = keys.get("scenario") if scenario is None else scenario
    if named is None:
        named = "hybrid"
    if isinstance(named, Path | str):
        keys["scenario"] = load_scenario(str(named)).model_dump()
    return parse_config(keys, "config")


def whole_number(name: str, value: Any, most: int | None = LARGEST) -> int:
    """``value`` as int; raises ValueError unless it is a whole number from 0 to ``most``.

    True and 1.0 are none: somebody meant something else.
    """
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < 0 or (most is not None and value > most):
        limit = "" if most is None else f" to {most}"
        raise ValueError(f"{name} must be a whole number from 0{limit}, not {value!r}")
    return int(value)


def scale_factor(value: Any) -> float:
    """``reward_scale`` as float; raises ValueError unless it is a finite number above 0."""
    is_number = isinstance(value, int | float | np.integer | np.floating)
    if not is_number or isinstance(value, bool) or not (value > 0.0 and math.isfinite(value)):
        raise ValueError(f"reward_scale must be a finite number above 0, not {value!r}")
    return float(value)


def episode_option(options: Mapping[str, Any] | None) -> int | None:
    """``episode`` of ``reset``'s options; raises ValueError for any other option."""
    if options is None:
        return None
    if not isinstance(options, Mapping):
        raise ValueError(f"options must be a dict with the key episode, not {options!r}")
    unknown = [key for key in options if key != "episode"]
    if unknown:
        raise ValueError(f"option {unknown[0]!r} is unknown; known: episode")
    episode = options.get("episode")
    return None if episode is None else whole_number("options['episode']", episode)


def plain_spec(spec: EnvSpec | None) -> EnvSpec | None:
    """``spec`` with its arguments as plain data, so that ``to_json`` can write it."""
    return None if spec is None else dataclasses.replace(spec, kwargs=_plain(spec.kwargs))


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
