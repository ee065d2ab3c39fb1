"""The page about deployment: its ten lines drive an exported policy without lndrl."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from lndrl.navigation import Observation, action_table
from lndrl.navigation.observation import quantise
from lndrl.policy import PolicyRunner
from lndrl.policy.export import export_policy
from tests.lndrl.policy.export.rooms import made_config, weights_of

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "deployment.md").read_text()
# Whoever imports a name that is None in there is told that there is no such module.
ALONE = (
    "import sys\n"
    "for name in ('lndrl', 'torch', 'numba'):\n"
    "    sys.modules[name] = None\n"
    "try:\n"
    "    import lndrl\n"
    "except ImportError:\n"
    "    exec(compile(open('drive.py').read(), 'drive.py', 'exec'))\n"
)


def test_ten_lines_drive_it_without_lndrl(tmp_path: Path) -> None:
    (text,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert len([line for line in text.splitlines() if line]) == 10
    config = made_config()
    weights = weights_of(config, seed=3)
    export_policy(config, weights, "here", 20, timed=0.01).write(tmp_path / "policy.onnx")
    (tmp_path / "drive.py").write_text(text)
    command = [sys.executable, "-I", "-c", ALONE]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    # The policy itself, in the situation that the page describes.
    seen = Observation.zeros_for(1, config)
    seen.scan[:] = quantise(np.full((1, 720), np.inf), 12.0)
    seen.pedestrians[0, 0] = 1.5, 0.2, -0.4, 0.0
    seen.pedestrian_count[:] = 1
    seen.goal[:] = 4.0, 1.0, 0.0, 0.01, 0.01, 0.002
    runner = PolicyRunner(config)
    runner.load(weights)
    likeliest = int(runner.log_probabilities(seen).argmax())
    v, w = action_table(config.task)[likeliest]
    assert done.stdout.strip() == str({"index": likeliest, "v": float(v), "w": float(w)})


def test_the_page_explains_every_key_of_the_contract(tmp_path: Path) -> None:
    config = made_config({"scan_frames": 3}, scan_encoder="fan")
    export_policy(config, weights_of(config), "here", 5, timed=0.01).write(tmp_path / "p.onnx")
    contract = json.loads((tmp_path / "p.json").read_text())
    parts = [contract, *contract["inputs"], *contract["outputs"], contract["actions"][0]]
    parts += [contract[part] for part in ("policy", "timing", "task", "file")]
    names = {entry["name"] for entry in contract["inputs"] + contract["outputs"]}
    missing = {key for part in parts for key in part} | names
    assert {key for key in missing if f"`{key}`" not in PAGE} == set()
