"""From a network to an ONNX model, by torch's exporter, and what is said where that fails."""

from __future__ import annotations

import logging
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from lndrl.config import RunConfig
from lndrl.config.learning import BUILT_IN, SCAN_ENCODERS
from lndrl.errors import UserError
from lndrl.policy.export.graph import OUTPUT, ROWS, PolicyGraph, example_inputs
from lndrl.policy.networks import Network

if TYPE_CHECKING:
    import onnx

OPSET = 18
"""Of the operators used: the oldest that torch writes."""
IR_VERSION = 8
"""Of the file's format: that of OPSET's time. What newer ones add, a policy does not use."""
NEEDED = ("onnx", "onnxruntime", "onnxscript")
_OURS = (Path(__file__).resolve().parents[2], Path(torch.__file__).parent)
_LONGEST = 160  # of what torch says


def check_installed() -> None:
    """Raise UserError, with the command that mends it, where a package is not there."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise UserError(
            f"lndrl export needs {' and '.join(missing)}, which this Python does not have; "
            f"install with: pip install {' '.join(missing)}"
        )


def to_onnx(
    config: RunConfig, network: Network, where: str, temperature: float = 1.0
) -> onnx.ModelProto:
    """``network`` as an ONNX model that reads what ``example_inputs`` shows, N rows at once.

    Its log-probabilities are those at ``temperature``. Raises UserError, ``where`` in front, for a
    network that cannot be exported.
    """
    module = PolicyGraph(config, network, temperature).eval().requires_grad_(False)
    inputs = example_inputs(config)
    rows = torch.export.Dim(ROWS, min=1)
    shapes = {name: {0: rows} for name in inputs}
    with _quiet():
        try:
            # Not torch's older, tracing exporter: that one turns what it does not see, like our
            # compiled kernels, into constants, where this one refuses.
            program = torch.export.export(module, (), inputs, dynamic_shapes=shapes, strict=False)
            converted = torch.onnx.export(
                program, dynamo=True, opset_version=OPSET, output_names=[OUTPUT], verbose=False
            )
        except Exception as error:
            raise UserError(
                f"{where}: {_whose(config)} cannot be exported: {_words(error)}"
            ) from error
    assert converted is not None
    model = converted.model_proto
    _anonymize(model)
    _name_rows(model)
    model.ir_version = IR_VERSION
    return model


def _anonymize(model: onnx.ModelProto) -> None:
    """Leave out what torch notes for its developers.

    That is at every node a stack trace: paths of this machine and lines of the user's own code.
    """
    graph = model.graph
    model.doc_string = graph.doc_string = ""
    for part in (*graph.node, *graph.value_info, *graph.initializer, *graph.input, *graph.output):
        part.doc_string = ""
        del part.metadata_props[:]
    del graph.metadata_props[:]
    graph.name = "policy"


def _name_rows(model: onnx.ModelProto) -> None:
    """Call the number of rows N, whatever torch called it."""
    graph = model.graph
    torchs = graph.input[0].type.tensor_type.shape.dim[0].dim_param
    for part in (*graph.input, *graph.output, *graph.value_info):
        for dimension in part.type.tensor_type.shape.dim:
            if dimension.dim_param == torchs:
                dimension.dim_param = ROWS


@contextmanager
def _quiet() -> Iterator[None]:
    """Without torch's notes on packages that nobody needs here, and on what it then refuses."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def whose_parts(config: RunConfig) -> list[str]:
    """Parts of the user's own in the network of ``config``, as ``policy network m:Class``."""
    network = config.network
    if network.policy != BUILT_IN:
        return [f"policy network {network.policy}"]
    found = []
    if network.scan_encoder not in SCAN_ENCODERS:
        found.append(f"scan encoder {network.scan_encoder}")
    if network.pedestrian_map and network.map_encoder != BUILT_IN:
        found.append(f"map encoder {network.map_encoder}")
    return found


def _whose(config: RunConfig) -> str:
    parts = whose_parts(config)
    return f"the network with {' and '.join(parts)}" if parts else "this network"


def _words(error: BaseException) -> str:
    """The error at the bottom of ``error``, its first line, and the user's line it came from."""
    places = []
    while True:
        places += [
            f"{Path(frame.filename).name}, line {frame.lineno}"
            for frame in traceback.extract_tb(error.__traceback__)
            if not any(Path(frame.filename).is_relative_to(folder) for folder in _OURS)
            and Path(frame.filename).is_file()
        ]
        below = error.__cause__ or error.__context__
        if below is None:
            break
        error = below
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    said = (lines[0] if lines else "")[:_LONGEST].rstrip(". ")
    place = f" ({places[-1]})" if places else ""
    return (
        f"{type(error).__name__}: {said}{place}; a graph is made of tensor operations alone: "
        "no numpy, no branches on values, x.shape[0] instead of len(x)"
    )
