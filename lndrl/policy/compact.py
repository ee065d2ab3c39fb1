"""Observations as they travel, on a device: uploaded small, made into inputs there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lndrl.config import TaskConfig
from lndrl.navigation import Observation
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.policy.raster import draw_on_device

Rows = slice | Tensor


@dataclass(frozen=True)
class CompactObservation:
    """N observations of about 1.9 kB each, where their dense inputs would be 30 kB.

    scan: int16 (N, beams), the bits of uint16 counts (few kernels know uint16). people float32
    (N, P, 4), count uint8 (N,) and goal float32 (N, 6) as in Observation.
    """

    scan: Tensor
    people: Tensor
    count: Tensor
    goal: Tensor

    @classmethod
    def view(cls, observation: Observation) -> CompactObservation:
        """The arrays of ``observation`` (N,) as tensors of the same memory where it is writable."""
        return cls(
            _tensor(observation.scan.view(np.int16)),
            _tensor(observation.pedestrians),
            _tensor(observation.pedestrian_count),
            _tensor(observation.goal),
        )

    def to(self, device: torch.device | str) -> CompactObservation:
        """The same on ``device``; from pinned memory without waiting."""
        return CompactObservation(*(t.to(device, non_blocking=True) for t in self._tensors()))

    def copy_(self, rows: CompactObservation) -> None:
        """Copy ``rows`` into the first places; from pinned memory without waiting."""
        for place, given in zip(self._tensors(), rows._tensors(), strict=True):
            place[: len(given)].copy_(given, non_blocking=True)

    def take(self, rows: Rows) -> CompactObservation:
        """Rows by a slice (views) or by indices int64 on the same device."""
        if isinstance(rows, slice):
            return CompactObservation(*(t[rows] for t in self._tensors()))
        return CompactObservation(*(t.index_select(0, rows) for t in self._tensors()))

    def expand(self, task: TaskConfig) -> tuple[Tensor, Tensor, Tensor]:
        """Scan float32 (N, beams) in [0, 1], goal (N, 6), maps float32 (N, 3, cells, cells)."""
        counts = self.scan.to(torch.int32).bitwise_and_(SCAN_COUNTS)
        scan = counts.to(torch.float32).mul_(1.0 / SCAN_COUNTS)
        return scan, self.goal, draw_on_device(self.people, self.count, task)

    def _tensors(self) -> tuple[Tensor, ...]:
        return self.scan, self.people, self.count, self.goal


def _tensor(array: NDArray[np.generic]) -> Tensor:
    # Arrays may be views of a received message, which torch must not be handed as its own.
    return torch.from_numpy(array if array.flags.writeable else array.copy())
