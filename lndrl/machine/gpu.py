"""How busy NVIDIA's GPUs of this machine are, told by the driver; the extra ``gpu``."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from typing import Any


class Cards:
    """The GPUs of this machine; none where nvidia-ml-py, the driver or a card is missing."""

    def __init__(self) -> None:
        self._driver: Any = None
        self._handles: list[Any] = []
        with suppress(Exception):  # whatever is missing: a machine without GPUs is none that failed
            driver = import_module("pynvml")
            driver.nvmlInit()
            count = driver.nvmlDeviceGetCount()
            self._handles = [driver.nvmlDeviceGetHandleByIndex(i) for i in range(count)]
            self._driver = driver

    def now(self) -> dict[str, float]:
        """``gpus``, and in use of all of them: ``gpu`` (share of the time), ``gpu_memory``.

        A card that does not answer, as one that has been divided, is left out; empty without one.
        """
        shares, used, total = [], 0.0, 0.0
        for handle in self._handles:
            with suppress(Exception):
                memory = self._driver.nvmlDeviceGetMemoryInfo(handle)
                share = self._driver.nvmlDeviceGetUtilizationRates(handle).gpu / 100.0
                shares.append(min(max(share, 0.0), 1.0))
                used, total = used + float(memory.used), total + float(memory.total)
        if not shares:
            return {}
        return {
            "gpus": float(len(shares)),
            "gpu": sum(shares) / len(shares),
            "gpu_memory": min(max(used / total, 0.0), 1.0) if total > 0 else 0.0,
        }
