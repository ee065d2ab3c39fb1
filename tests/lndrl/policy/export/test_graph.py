"""What the exported graph makes of measurements, seen through ONNX Runtime."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from lndrl.config import RunConfig
from lndrl.navigation import draw_pedestrian_map
from lndrl.navigation.observation import SCAN_COUNTS, quantise
from lndrl.policy import Inputs
from lndrl.policy.export import open_session, to_onnx
from tests.lndrl.policy.export.rooms import made_config

SIDE = 24
CONFIG = made_config({"map_cells": SIDE})


class Mirror(nn.Module):
    """Answers with what it reads, and a zero in front that undoes the softmax."""

    def forward(self, inputs: Inputs) -> Tensor:
        assert isinstance(inputs.people, Tensor)
        zero = torch.zeros_like(inputs.goal[:, :1])
        return torch.cat((zero, inputs.scan, inputs.goal, inputs.people.flatten(1)), dim=1)


class Reads:
    """Scan, goal and maps that the network behind the graph reads."""

    def __init__(self, config: RunConfig) -> None:
        model = to_onnx(config, Mirror(), "here")  # type: ignore[arg-type]
        self.session: onnxruntime.InferenceSession = open_session(model.SerializeToString())
        self.beams = config.world.laser.beams

    def __call__(
        self,
        scan: NDArray[np.floating] | None = None,
        people: NDArray[np.float32] | None = None,
        count: NDArray[np.integer] | None = None,
        goal: NDArray[np.float32] | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        rows = next(len(a) for a in (scan, people, goal) if a is not None)
        feeds = {
            "scan": np.zeros((rows, self.beams)) if scan is None else scan,
            "people": np.zeros((rows, 24, 4)) if people is None else people,
            "goal": np.zeros((rows, 6)) if goal is None else goal,
        }
        given = {name: array.astype(np.float32) for name, array in feeds.items()}
        given["count"] = np.zeros(rows, np.int64) if count is None else count.astype(np.int64)
        (answer,) = self.session.run(None, given)
        values = answer[:, 1:] - answer[:, :1]
        scans, goals, maps = np.split(values, [self.beams, self.beams + 6], axis=1)
        return scans, goals, maps.reshape(rows, 3, SIDE, SIDE)


@pytest.fixture(scope="module")
def reads() -> Reads:
    return Reads(CONFIG)


def test_a_scan_is_read_as_the_observation_reads_it(reads: Reads) -> None:
    limit = CONFIG.world.laser.range_max
    rng = np.random.default_rng(0)
    metres = rng.uniform(-1.0, limit + 1.0, (5, 720)).astype(np.float32)
    metres[0, :8] = [np.nan, np.inf, -np.inf, -0.0, limit, np.nextafter(limit, 0), 1e30, -1e-9]
    # The middle between two counts, where both sides must round alike.
    metres[1] = (np.arange(720) + 0.5) * limit / SCAN_COUNTS
    expected = quantise(metres, limit) * np.float32(1.0 / SCAN_COUNTS)
    seen, _, _ = reads(scan=metres)
    # A count is 1.5e-5: what differs by less was the same count.
    np.testing.assert_allclose(seen, expected, atol=5e-6)
    assert (expected[0, :8] == [1, 1, 0, 0, 1, 1, 1, 0]).all()


def crowds(rows: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """People on round coordinates, so that cells lie on rims; some out of view, some overlap."""
    rng = np.random.default_rng(1)
    people = rng.normal(0.0, 1.0, (rows, 24, 4)).astype(np.float32)
    people[..., :2] = rng.integers(-28, 29, (rows, 24, 2)) * np.float32(0.125)
    people[::2, :, :2] += rng.normal(0.0, 0.1, (rows + 1) // 2 * 48).reshape(-1, 24, 2)
    count = rng.integers(0, 25, rows).astype(np.uint8)
    count[:3] = [0, 24, 1]
    for row, valid in enumerate(count):
        people[row, valid:] = [np.nan, 0.3, np.inf, 1.0][row % 4]  # rubbish that nobody must see
    people[3:6, 0] = [[np.nan, 0, 1, 1], [np.inf, 0, 1, 1], [3.0, -3.0, 1, 1]]
    return people, count


def test_the_map_is_drawn_as_ever(reads: Reads) -> None:
    people, count = crowds(200)
    expected = draw_pedestrian_map(people, count, CONFIG.task)
    _, _, maps = reads(people=people, count=count)
    assert (np.rint(maps[:, 0]) == expected[:, 0]).all()
    np.testing.assert_allclose(maps, expected, atol=5e-6)
    assert expected[:, 0].any(axis=(1, 2)).mean() > 0.8


def test_the_farther_of_two_covers_the_nearer(reads: Reads) -> None:
    people = np.zeros((2, 24, 4), np.float32)
    people[:, :2] = [[1.0, 0.0, 0.5, 0.0], [1.1, 0.0, -0.5, 0.0]]
    _, _, maps = reads(people=people, count=np.array([2, 1]))
    assert maps[0, 1].min() < -0.4 and maps[1, 1].min() > -0.1
    assert reads(people=people, count=np.array([99, -1]))[2][1].max() < 1e-5


def test_variances_are_clipped_and_the_rest_of_the_goal_is_not(reads: Reads) -> None:
    goal = np.array([[-40.0, 30.0, 3.0, 12.0, np.nan, np.inf], [1, 2, 3, 0.5, 10.0, 0.0]], "f")
    _, seen, _ = reads(goal=goal)
    limit = CONFIG.task.variance_limit
    expected = [[-40.0, 30.0, 3.0, limit, limit, limit], [1, 2, 3, 0.5, limit, 0.0]]
    np.testing.assert_allclose(seen, expected, atol=1e-4)
