"""Networks that become graphs, and those that cannot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import onnx
import pytest
import torch

from lndrl.errors import UserError
from lndrl.policy import build_policy, load_into
from lndrl.policy.export import Exported, check_installed, convert, to_onnx
from tests.lndrl.policy.export.rooms import made_config, weights_of

Write = Callable[..., str]
NETWORK = """
    import torch
    from torch import nn

    class Net(nn.Module):
        def __init__(self, config, outputs):
            super().__init__()
            self.layer = nn.Linear(720, outputs)

        def forward(self, inputs):
            return {answer}
"""
ENCODER = """
    import torch
    from torch import nn

    class Enc(nn.Module):
        def __init__(self, config):
            super().__init__()
            self.features = 5
            self.layer = nn.Linear(1, 5)

        def forward(self, values):
            return {answer}
"""


def shapes(model: onnx.ModelProto) -> dict[str, list[int | str]]:
    return {
        part.name: [d.dim_param or d.dim_value for d in part.type.tensor_type.shape.dim]
        for part in (*model.graph.input, *model.graph.output)
    }


def test_inputs_and_output_are_those_of_the_contract(exported: Exported) -> None:
    model = onnx.load_from_string(exported.model)
    onnx.checker.check_model(model, full_check=True)
    assert shapes(model) == {
        "scan": ["N", 720],
        "people": ["N", 24, 4],
        "count": ["N"],
        "goal": ["N", 6],
        "log_probabilities": ["N", 28],
    }
    (operators,) = model.opset_import
    assert (operators.domain, operators.version, model.ir_version) == ("", 18, 8)


def test_what_is_not_read_is_not_asked_for() -> None:
    config = made_config(pedestrian_map=False, variances=False)
    model = to_onnx(config, build_policy(config), "here")
    assert shapes(model) == {"scan": ["N", 720], "goal": ["N", 3], "log_probabilities": ["N", 28]}


def test_the_file_tells_nothing_of_the_machine_it_was_made_on(exported: Exported) -> None:
    config = made_config()
    network = build_policy(config, initialize=False)
    load_into(network, weights_of(config))
    blob = to_onnx(config, network, "here").SerializeToString()
    assert b".py" not in blob and b"stack_trace" not in blob
    other = onnx.load_from_string(exported.model)
    del other.metadata_props[:]  # the contract, which comes later
    assert other.SerializeToString() == blob


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        ("self.layer(torch.from_numpy(inputs.scan.numpy()))", r"RuntimeError: .*, line 11\)"),
        ("self.layer(inputs.scan if inputs.goal.sum() > 1 else -inputs.scan)", r", line 11\)"),
        ("torch.stack([self.layer(inputs.scan[i]) for i in range(len(inputs.scan))])", "len"),
        (
            "self.layer(inputs.scan)"
            " + torch.linalg.eigvals(inputs.people[:, 0]).real.sum(1, keepdim=True)",
            "No ONNX function found",
        ),
    ],
)
def test_a_network_that_cannot_be_exported(own_module: Write, answer: str, sentence: str) -> None:
    name = own_module(NETWORK.format(answer=answer))
    config = made_config(policy=f"{name}:Net")
    network = build_policy(config)
    with pytest.raises(UserError, match=sentence) as refused:
        to_onnx(config, network, "runs/r")
    said = str(refused.value)
    assert said.startswith(f"runs/r: the network with policy network {name}:Net cannot be exported")
    assert len(said) < 450 and "\n" not in said and said.endswith("x.shape[0] instead of len(x)")


@pytest.mark.parametrize("key", ["scan_encoder", "map_encoder"])
def test_an_encoder_that_cannot_be_exported(own_module: Write, key: str) -> None:
    answer = "self.layer(torch.tensor([[float(v.mean())] for v in values]))"
    name = own_module(ENCODER.format(answer=answer))
    config = made_config(**{key: f"{name}:Enc"})
    said = f"the network with {key.replace('_', ' ')} {name}:Enc cannot be exported: "
    with pytest.raises(UserError, match=said):
        to_onnx(config, build_policy(config), "runs/r")


def test_compiled_kernels_are_refused_not_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    config = made_config()
    network = build_policy(config)
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: False)
    with pytest.raises(UserError, match=r"^here: this network cannot be exported: RuntimeError"):
        to_onnx(config, network, "here")


def test_a_missing_package_is_named_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    check_installed()
    there = convert.find_spec

    def hide(name: str) -> Any:
        return None if name.startswith("onnxr") else there(name)

    monkeypatch.setattr(convert, "find_spec", hide)
    with pytest.raises(UserError, match=r"needs onnxruntime, .* pip install onnxruntime$"):
        check_installed()
