"""Devices by name; what is not there is said in a sentence."""

from __future__ import annotations

import pytest
import torch

from lndrl.errors import UserError
from lndrl.policy import resolve_device


@pytest.fixture
def gpus(monkeypatch):
    """Pretend that torch was built for CUDA and sees ``count`` GPUs."""

    def pretend(count: int) -> None:
        monkeypatch.setattr(torch.version, "cuda", "13.0")
        monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
        monkeypatch.setattr(torch.cuda, "device_count", lambda: count)

    return pretend


def test_auto_takes_a_gpu_where_there_is_one(gpus) -> None:
    gpus(0)
    assert resolve_device("auto") == torch.device("cpu")
    gpus(2)
    assert resolve_device("auto") == resolve_device("cuda") == torch.device("cuda", 0)
    assert resolve_device("cuda:1") == torch.device("cuda", 1)
    assert resolve_device("cpu") == torch.device("cpu")


def test_what_is_not_there_is_said(gpus, monkeypatch) -> None:
    gpus(1)
    with pytest.raises(UserError, match=r"cuda:3.*this machine has cuda:0"):
        resolve_device("cuda:3")
    gpus(0)
    with pytest.raises(UserError, match="finds no GPU here"):
        resolve_device("cuda")
    monkeypatch.setattr(torch.version, "cuda", None)
    monkeypatch.setattr(torch.version, "hip", None)
    with pytest.raises(UserError, match="built for CPUs only"):
        resolve_device("cuda")
    for name in ("gpu", "mps", "cuda:x"):
        with pytest.raises(UserError, match="not a device; write cpu"):
            resolve_device(name)
