"""The run that is benched, and the folder of it."""

from __future__ import annotations

from collections.abc import Sequence

from lndrl.bench.training import CONFIG, SETTINGS
from lndrl.config import RunConfig, load_config


def fleet_config(settings: Sequence[str]) -> RunConfig:
    """What ``lndrl bench train`` trains, but for ``settings`` (key=value), and without an end."""
    endless = "learner.total_steps=1000000000000"
    return load_config(CONFIG, [*SETTINGS, endless, *settings])
