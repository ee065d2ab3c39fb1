"""The belief: particle filter on a known map (AMCL), and a perfect double."""

from lndrl.localization.amcl import AMCL, amcl_beam_stride
from lndrl.localization.likelihood import LikelihoodMap
from lndrl.localization.perfect import PerfectLocalization

__all__ = ["AMCL", "LikelihoodMap", "PerfectLocalization", "amcl_beam_stride"]
