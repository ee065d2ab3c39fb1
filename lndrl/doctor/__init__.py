"""What is wrong with a connection, in words: ``lndrl doctor``."""

from lndrl.doctor.diagnosis import Target, diagnose
from lndrl.doctor.probes import Check

__all__ = ["Check", "Target", "diagnose"]
