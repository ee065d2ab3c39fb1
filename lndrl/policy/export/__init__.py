"""A policy leaves the house: an ONNX file, its contract, and proof that it computes the same."""

from lndrl.policy.export.check import (
    RoundTrip,
    feeds_for,
    observations_met,
    open_session,
    round_trip,
)
from lndrl.policy.export.contract import METADATA_KEY, contract_for
from lndrl.policy.export.convert import check_installed, to_onnx
from lndrl.policy.export.export import Exported, contract_beside, export_policy

__all__ = [
    "METADATA_KEY",
    "Exported",
    "RoundTrip",
    "check_installed",
    "contract_beside",
    "contract_for",
    "export_policy",
    "feeds_for",
    "observations_met",
    "open_session",
    "round_trip",
    "to_onnx",
]
