"""Maps drawn with tensors against the kernel, and compact observations against ``prepare``."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from lndrl.config import TaskConfig
from lndrl.navigation import draw_pedestrian_map
from lndrl.policy import CompactObservation, prepare
from lndrl.policy.raster import draw_on_device
from tests.lndrl.policy.test_networks import make_config, random_observation

TASKS = [
    TaskConfig(),
    TaskConfig(map_cells=31, map_extent=5.0, pedestrian_radius=0.55),
    TaskConfig(map_cells=8, map_extent=1.0, pedestrian_radius=0.9),  # a disc larger than the map
    TaskConfig(pedestrian_radius=0.01),  # mostly between the centres
    TaskConfig(map_cells=8, map_extent=8.0, pedestrian_radius=1.0),  # centres exactly on the rim
]
NAMES = ["paper", "odd", "large", "tiny", "exact"]
DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.cuda)]


def assert_drawn_alike(
    people: np.ndarray, count: np.ndarray, task: TaskConfig, device: str
) -> None:
    expected = draw_pedestrian_map(people, count, task)
    maps = draw_on_device(
        torch.from_numpy(people).to(device), torch.from_numpy(count).to(device), task
    )
    assert maps.is_contiguous(memory_format=torch.channels_last)
    np.testing.assert_array_equal(maps.cpu().numpy(), expected)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("task", TASKS, ids=NAMES)
@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([0.2, 0.5, 1.02, 1.4]))
def test_random_people_in_and_out_of_the_map(
    device: str, task: TaskConfig, seed: int, spread: float
) -> None:
    rng = np.random.default_rng(seed)
    reach = 0.5 * spread * task.map_extent
    people = rng.uniform(-reach, reach, (4, 24, 4)).astype(np.float32)
    assert_drawn_alike(people, rng.integers(0, 25, 4).astype(np.uint8), task, device)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("task", TASKS, ids=NAMES)
@given(seed=st.integers(0, 2**32 - 1))
def test_people_on_borders_centres_and_rims(device: str, task: TaskConfig, seed: int) -> None:
    """Places where rounding decides: half cells, the map's border, a radius off a centre."""
    rng = np.random.default_rng(seed)
    size = task.map_extent / task.map_cells
    people = rng.uniform(-1, 1, (4, 24, 4))
    places = rng.integers(-1, task.map_cells + 2, (4, 24, 2)) * size - 0.5 * task.map_extent
    places += rng.choice([0.0, 0.5 * size, 0.25 * size], (4, 24, 2))
    places += rng.choice([0.0, task.pedestrian_radius, -task.pedestrian_radius], (4, 24, 2))
    people[..., :2] = places
    people[0, :4, :2] = np.array([[1, 1], [-1, 1], [1, -1], [0, 1]]) * 0.5 * task.map_extent
    assert_drawn_alike(people.astype(np.float32), np.array([24, 24, 5, 0], np.uint8), task, device)


def test_nothing_is_made_on_another_device() -> None:
    """Tensors of the host would not mix with those of "meta", nor with a GPU's."""
    config = make_config(map_channels=(4, 4, 4), features=8)
    observation = random_observation(np.random.default_rng(0), 3, 2.0)
    made = CompactObservation.view(observation).to("meta").expand(config.task)
    assert {tensor.device.type for tensor in made} == {"meta"}
    assert [tuple(tensor.shape) for tensor in made] == [(3, 720), (3, 6), (3, 3, 48, 48)]


@pytest.mark.parametrize("device", DEVICES)
def test_compact_observations_make_the_same_inputs(device: str) -> None:
    config = make_config(pooling="none", map_channels=(2, 2, 2), features=8)
    observation = random_observation(np.random.default_rng(1), 5, 3.0)
    observation.scan[0, :3] = 0, 32768, 65535
    observation.scan.flags.writeable = False  # as received
    compact = CompactObservation.view(observation).to(device)
    rows = torch.tensor([4, 0, 0], device=device)
    scan, goal, people = compact.take(rows).expand(config.task)
    expected = prepare(observation.take(rows.cpu().numpy()), config)
    np.testing.assert_array_equal(scan.cpu().numpy(), expected.scan.numpy())
    np.testing.assert_array_equal(goal.cpu().numpy(), expected.goal.numpy())
    drawn = draw_pedestrian_map(observation.pedestrians, observation.pedestrian_count, config.task)
    np.testing.assert_array_equal(people.cpu().numpy(), drawn[[4, 0, 0]])
    assert float(scan[1, 1]) == pytest.approx(32768 / 65535)


def test_rows_are_copied_into_the_first_places() -> None:
    large = CompactObservation.view(random_observation(np.random.default_rng(2), 4, 1.0))
    small = CompactObservation.view(random_observation(np.random.default_rng(3), 2, 1.0))
    kept = large.goal[2:].clone()
    large.copy_(small)
    assert torch.equal(large.goal[:2], small.goal) and torch.equal(large.goal[2:], kept)
    assert torch.equal(large.scan[:2], small.scan) and torch.equal(large.people[:2], small.people)
