"""The paper's networks, their sparse evaluation, weights in and out, and acting.

Reading weights and acting need no torch; what does is imported when it is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from lndrl.policy.acting import (
    LocalPolicy,
    PolicyRunner,
    act_on_one_thread,
    load_engine,
    local_policy,
)
from lndrl.policy.arrays import ArrayInputs, array_inputs, pooling_factor, supports_sparse
from lndrl.policy.layout import check_layout
from lndrl.policy.weights import (
    POLICY_FILE,
    TEMPERATURE_KEY,
    Guidance,
    driven_at,
    load_policy,
    policy_metadata,
    read_policy,
)

if TYPE_CHECKING:
    from lndrl.policy.activations import FirstLayer, first_layer
    from lndrl.policy.compact import CompactObservation
    from lndrl.policy.device import resolve_device
    from lndrl.policy.graphs import EAGER_RUNS, Record, record_cuda_graph
    from lndrl.policy.inputs import Inputs, prepare
    from lndrl.policy.networks import NavigationNetwork, Network, build_policy, build_value
    from lndrl.policy.tensors import initial_weights, load_into, to_bytes

_BY_TORCH = {
    "activations": ("FirstLayer", "first_layer"),
    "compact": ("CompactObservation",),
    "device": ("resolve_device",),
    "graphs": ("EAGER_RUNS", "Record", "record_cuda_graph"),
    "inputs": ("Inputs", "prepare"),
    "networks": ("NavigationNetwork", "Network", "build_policy", "build_value"),
    "tensors": ("initial_weights", "load_into", "to_bytes"),
}
_MODULES = {name: module for module, names in _BY_TORCH.items() for name in names}

__all__ = [
    "EAGER_RUNS",
    "POLICY_FILE",
    "TEMPERATURE_KEY",
    "ArrayInputs",
    "CompactObservation",
    "FirstLayer",
    "Guidance",
    "Inputs",
    "LocalPolicy",
    "NavigationNetwork",
    "Network",
    "PolicyRunner",
    "Record",
    "act_on_one_thread",
    "array_inputs",
    "build_policy",
    "build_value",
    "check_layout",
    "driven_at",
    "first_layer",
    "initial_weights",
    "load_engine",
    "load_into",
    "load_policy",
    "local_policy",
    "policy_metadata",
    "pooling_factor",
    "prepare",
    "read_policy",
    "record_cuda_graph",
    "resolve_device",
    "supports_sparse",
    "to_bytes",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
