"""When a step runs, is recorded, and is replayed; the recorder is a stand-in."""

from __future__ import annotations

import torch

from learner.ppo.graphs import GraphedStep


class Device:
    """Does steps at once, and records them without doing them, as CUDA does."""

    def __init__(self) -> None:
        self.done: list[list[int]] = []
        self.recorded = 0

    def step(self, rows: torch.Tensor) -> None:
        self.done.append(rows.tolist())

    def record(self, work):
        self.recorded += 1
        return work


def test_every_step_is_done_once_on_its_own_rows() -> None:
    device = Device()
    step = GraphedStep(device.step, device.record)
    given = [[i, i + 1, i + 2] for i in range(6)] + [[7, 8], [1, 2, 3], [9, 9]]
    for rows in given:
        step(torch.tensor(rows))
    assert device.done == given
    assert device.recorded == 1  # two rows came only twice


def test_graphs_are_forgotten_and_few() -> None:
    device = Device()
    step = GraphedStep(device.step, device.record)
    for count in range(1, 8):
        for _ in range(5):
            step(torch.arange(count))
    assert device.recorded == 4
    assert [len(rows) for rows in device.done] == [n for n in range(1, 8) for _ in range(5)]
    step.forget()
    step(torch.arange(1))
    assert device.recorded == 4
    for _ in range(3):
        step(torch.arange(1))
    assert device.recorded == 5
