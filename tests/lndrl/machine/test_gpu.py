from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

from lndrl.machine.gpu import Cards
from lndrl.machine.load import Load


def driver(busy: list[int], used: int = 10, total: int = 40) -> SimpleNamespace:
    """A stand-in for nvidia-ml-py; a card that is busy for less than nothing does not answer."""

    def use(card: int) -> SimpleNamespace:
        if busy[card] < 0:
            raise RuntimeError("not supported")
        return SimpleNamespace(gpu=busy[card], memory=0)

    return SimpleNamespace(
        nvmlInit=lambda: None,
        nvmlDeviceGetCount=lambda: len(busy),
        nvmlDeviceGetHandleByIndex=lambda i: i,
        nvmlDeviceGetUtilizationRates=use,
        nvmlDeviceGetMemoryInfo=lambda card: SimpleNamespace(used=used, total=total),
    )


def test_gpus_are_told_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pynvml", driver([100, 50]))
    assert Cards().now() == {"gpus": 2.0, "gpu": 0.75, "gpu_memory": 0.25}
    assert Load(every=0.0).now()["gpus"] == 2.0


@pytest.mark.parametrize("module", [None, SimpleNamespace(), driver([]), driver([-1])])
def test_without_one_nothing_is_said(
    module: SimpleNamespace | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pynvml", module)  # None: it cannot be imported
    assert Cards().now() == {}
    assert "gpu" not in Load(every=0.0).now()


def test_a_card_that_does_not_answer_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pynvml", driver([-1, 80]))
    assert Cards().now() == {"gpus": 1.0, "gpu": 0.8, "gpu_memory": 0.25}
