"""``lndrl export`` as a user meets it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from lndrl.cli.main import run
from lndrl.policy.export import convert
from tests.lndrl.policy.export.rooms import made_config, weights_of

Write = Callable[..., str]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a run that has one checkpoint."""
    config = made_config(pedestrian_map=False)
    checkpoint = tmp_path / "runs/r/checkpoints/step-000001234"
    checkpoint.mkdir(parents=True)
    (checkpoint / "policy.safetensors").write_bytes(weights_of(config))
    (tmp_path / "runs/r/config.yaml").write_text(yaml.safe_dump(config.model_dump(mode="json")))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("below", ["", "checkpoints/step-000001234/policy.safetensors"])
def test_a_run_becomes_two_files(
    here: Path, below: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["export", f"runs/r/{below}", "--out", "p.onnx", "--observations", "20"]) == 0
    out, err = capsys.readouterr()
    assert err.startswith(f"runs/r/{below}: newest checkpoint, step 1,234")
    size = Path("p.onnx").stat().st_size
    assert f"p.onnx: the policy after 1,234 steps, {size / 1e6:.1f} MB, opset 18; " in out
    assert "round trip: 20 observations met in room, largest difference" in out
    assert "decisions/s" in out and "Warning" not in err
    contract = json.loads(Path("p.json").read_text())
    assert contract["policy"]["steps"] == 1234 and contract["file"]["bytes"] == size


def test_figures_for_programs(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["export", "runs/r/checkpoints/step-000001234", "--out", "a.b.onnx", "--json"]
    assert run([*command, "--observations", "3"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["contract"], found["observations"], found["opset"]) == ("a.b.json", 3, 18)
    assert found["largest_difference"] < 1e-4 and found["decisions_per_second"] > 0


@pytest.mark.parametrize(
    ("policy", "out", "sentence"),
    [
        ("runs/r", "p.pt", "--out p.pt: must end in .onnx"),
        ("runs/r", "no/p.onnx", "--out no/p.onnx: there is no folder no"),
        ("runs/q", "p.onnx", "runs/q: no such run folder or weights file"),
        ("runs/r", "mine.onnx", "its contract would replace mine.json, which is something else"),
    ],
)
def test_bad_input_is_one_sentence(
    here: Path, policy: str, out: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("mine.json").write_text('{"mine": 1}')
    assert run(["export", policy, "--out", out]) == 2
    err = capsys.readouterr().err
    assert sentence in err and len(err.splitlines()) == 1
    assert not Path(out).exists() and Path("mine.json").read_text() == '{"mine": 1}'


def test_a_missing_package(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(convert, "find_spec", lambda name: None)
    assert run(["export", "runs/r", "--out", "p.onnx"]) == 2
    assert capsys.readouterr().err == (
        "lndrl: lndrl export needs onnx and onnxruntime and onnxscript, which this Python does not "
        "have; install with: pip install onnx onnxruntime onnxscript\n"
    )


def test_a_network_that_cannot_be_exported(
    here: Path, own_module: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    name = own_module("""
        import torch
        from torch import nn

        class Net(nn.Module):
            def __init__(self, config, outputs):
                super().__init__()
                self.layer = nn.Linear(720, outputs)

            def forward(self, inputs):
                return self.layer(torch.from_numpy(inputs.scan.numpy()))
    """)
    Path("own.safetensors").write_bytes(weights_of(made_config(policy=f"{name}:Net")))
    command = ["export", "own.safetensors", "--out", "p.onnx", "--trust-modules", name]
    assert run(command) == 2
    err = capsys.readouterr().err
    assert f"the network with policy network {name}:Net cannot be exported" in err
    assert len(err.splitlines()) == 1 and not Path("p.onnx").exists()
