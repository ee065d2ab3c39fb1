"""The belief: particle filter on a known map (AMCL), and a perfect double.

For worlds by the thousand: ``make_beliefs`` and the kernels ``reset_belief`` and ``update_belief``.
"""

from lndrl.localization.amcl import AMCL, amcl_beam_stride, beam_stride
from lndrl.localization.belief import (
    Belief,
    Field,
    Scratch,
    Settings,
    belief_of,
    make_beliefs,
    make_field,
    make_scratch,
    make_settings,
)
from lndrl.localization.bins import Bins, make_bins
from lndrl.localization.likelihood import LikelihoodMap
from lndrl.localization.perfect import PerfectLocalization
from lndrl.localization.resampling import kld_limits
from lndrl.localization.scanner import Scanner
from lndrl.localization.sensing import Health, Heard, SensorFilter
from lndrl.localization.stamps import OdometryHistory, compose, interpolate, relative
from lndrl.localization.update import (
    predict_belief,
    reset_belief,
    spread_belief,
    update_belief,
)

__all__ = [
    "AMCL",
    "Belief",
    "Bins",
    "Field",
    "Health",
    "Heard",
    "LikelihoodMap",
    "OdometryHistory",
    "PerfectLocalization",
    "Scanner",
    "Scratch",
    "SensorFilter",
    "Settings",
    "amcl_beam_stride",
    "beam_stride",
    "belief_of",
    "compose",
    "interpolate",
    "kld_limits",
    "make_beliefs",
    "make_bins",
    "make_field",
    "make_scratch",
    "make_settings",
    "predict_belief",
    "relative",
    "reset_belief",
    "spread_belief",
    "update_belief",
]
