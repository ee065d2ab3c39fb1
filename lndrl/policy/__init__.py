"""The paper's networks, their sparse evaluation, weights in and out, and acting."""

from lndrl.policy.activations import FirstLayer, first_layer
from lndrl.policy.compact import CompactObservation
from lndrl.policy.device import resolve_device
from lndrl.policy.graphs import EAGER_RUNS, Record, record_cuda_graph
from lndrl.policy.inference import PolicyRunner
from lndrl.policy.inputs import Inputs, prepare, supports_sparse
from lndrl.policy.layout import check_layout
from lndrl.policy.networks import NavigationNetwork, Network, build_policy, build_value
from lndrl.policy.weights import (
    POLICY_FILE,
    TEMPERATURE_KEY,
    Guidance,
    driven_at,
    initial_weights,
    load_into,
    load_policy,
    policy_metadata,
    read_policy,
    to_bytes,
)

__all__ = [
    "EAGER_RUNS",
    "POLICY_FILE",
    "TEMPERATURE_KEY",
    "CompactObservation",
    "FirstLayer",
    "Guidance",
    "Inputs",
    "NavigationNetwork",
    "Network",
    "PolicyRunner",
    "Record",
    "build_policy",
    "build_value",
    "driven_at",
    "first_layer",
    "check_layout",
    "initial_weights",
    "load_into",
    "load_policy",
    "policy_metadata",
    "read_policy",
    "prepare",
    "record_cuda_graph",
    "resolve_device",
    "supports_sparse",
    "to_bytes",
]
