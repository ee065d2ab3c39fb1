"""The pedestrian map drawn with tensors, on whatever device they are.

The same cells and the same order of painting as ``lndrl.navigation.pedestrian_map``, which says
what the picture means; tests hold the two together. Nothing here waits for the device, so that
it can become part of a CUDA graph.
"""

from __future__ import annotations

import torch
from torch import Tensor

from lndrl.config import TaskConfig


def draw_on_device(people: Tensor, count: Tensor, task: TaskConfig) -> Tensor:
    """Maps float32 (N, 3, cells, cells), channels last in memory, of people (N, P, 4).

    ``people`` float32 holds x, y, vx, vy in the robot frame (m, m/s), near to far; ``count`` (N,)
    of any integer type says how many rows of each sample are valid.
    """
    samples, capacity, _ = people.shape
    cells = task.map_cells
    order = torch.arange(1, capacity + 1, device=people.device)
    present = order <= count.unsqueeze(1)
    cell = _disc_cells(people[..., :2], present, task)
    # A cell belongs to the last, so farthest, who covers it; 0 is nobody.
    owner = torch.zeros(samples, cells * cells + 1, dtype=torch.int64, device=people.device)
    painter = order.view(1, -1, 1).expand_as(cell)
    owner.scatter_reduce_(1, cell.flatten(1), painter.flatten(1), "amax")
    ones = torch.ones(samples, capacity, 1, device=people.device)
    colours = torch.cat((ones, people[..., 2:]), dim=2)
    colours = torch.nn.functional.pad(colours, (0, 0, 1, 0))
    drawn = colours.gather(1, owner[:, :-1].unsqueeze(2).expand(-1, -1, 3))
    return drawn.view(samples, cells, cells, 3).permute(0, 3, 1, 2)


def _disc_cells(position: Tensor, present: Tensor, task: TaskConfig) -> Tensor:
    """Flat cells int64 (N, P, W * W) within the drawn radius; ``cells ** 2`` stands for none."""
    cells, radius = task.map_cells, task.pedestrian_radius
    half, size = 0.5 * task.map_extent, task.map_extent / task.map_cells
    # float64 and this order of operations, as in the kernel: cells on the rim are the same.
    position = position.double()
    present = present & (position.abs() <= half).all(2)
    # A disc covers at most 2 * radius / size + 1 lines; one more on each side for rounding.
    width = int(2.0 * radius / size) + 3
    first = torch.floor((half - position - radius) / size - 0.5).unsqueeze(3)
    lines = first + torch.arange(width, dtype=torch.float64, device=position.device)
    away = half - (lines + 0.5) * size - position.unsqueeze(3)
    squared = away * away
    on_map = (lines >= 0.0) & (lines < cells) & present[..., None, None]
    inside = squared[:, :, 0, :, None] + squared[:, :, 1, None, :] <= radius * radius
    inside = inside & on_map[:, :, 0, :, None] & on_map[:, :, 1, None, :]
    cell = lines[:, :, 0, :, None] * cells + lines[:, :, 1, None, :]
    return cell.masked_fill(~inside, float(cells * cells)).long().flatten(2)
