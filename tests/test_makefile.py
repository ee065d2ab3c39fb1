"""How the Makefile fills .venv."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LOCK = "pip install --quiet --requirement requirements.lock"
BY_PIP = "x/bin/python -m " + LOCK
BY_UV = "/a/uv pip install --quiet --python x/bin/python --requirement requirements.lock"


@pytest.mark.parametrize(("uv", "line"), [("/a/uv", f"{BY_UV} || {BY_PIP}"), ("", BY_PIP)])
def test_uv_installs_where_it_is_and_pip_what_it_cannot(uv: str, line: str) -> None:
    command = ["make", "--dry-run", "--always-make", "install", "VENV=x", f"UV={uv}"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert line in told.stdout.splitlines()
