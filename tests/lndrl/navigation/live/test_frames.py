"""A snapshot that has been sent is, as far as a screen can show it, the one that was taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.navigation import Navigation, WorldSnapshot, build_surroundings
from lndrl.navigation.live import Framer, grid_of, snapshot_of
from lndrl.transport.frames import ARRAYS, FRAME_LIMITS, GRID, decode_frame

ROOM = {
    "seed": 3,
    "scenario": {
        "name": "room",
        "size": [10.0, 8.0],
        "resolution": 0.1,
        "obstacles": [{"box": [4.5, 3.5, 5.5, 4.5]}],
        "pedestrians": {
            "count": [3, 3],
            "routes": [{"start": [1.0, 6.0, 3.0, 7.0], "goal": [7.0, 1.0, 9.0, 2.0]}],
        },
        "robot": [{"start": [1.0, 1.0, 3.0, 3.0], "goal": [7.0, 5.0, 9.0, 7.0]}],
    },
}


@pytest.fixture(scope="module")
def taken() -> WorldSnapshot:
    config = RunConfig.model_validate(ROOM)
    world = Navigation(*build_surroundings(config), config, 0)
    world.reset()
    for _ in range(3):
        world.step(0.6, 0.3)
    said = np.linspace(0.0, 1.0, 28)
    return world.snapshot(said / said.sum())


def sent(snapshot: WorldSnapshot, framer: Framer | None = None) -> WorldSnapshot:
    frame, arrays = decode_frame((framer or Framer("run", "actor-0")).frame(snapshot, 7))
    assert frame.weights_version == 7 and frame.actor_id == "actor-0"
    grid = grid_of(frame, arrays)
    assert grid is not None
    return snapshot_of(frame, arrays, grid)


def test_a_snapshot_knows_what_led_to_it(taken: WorldSnapshot) -> None:
    assert taken.actions[taken.action].tolist() == pytest.approx([0.6, 0.3])
    assert len(taken.parts) == len(taken.part_names) == 6 and taken.parts[-1] == -5.0
    assert taken.weights.sum() == pytest.approx(1.0) and len(taken.weights) == len(taken.particles)
    apart = taken.pose_true - taken.pose_estimated
    assert taken.position_error == pytest.approx(float(np.hypot(apart[0], apart[1])))
    assert taken.pose_odometry[:2] == pytest.approx(
        [np.hypot(*(taken.pose_true - taken.start_pose)[:2]), 0.0], abs=0.3
    )


def test_what_arrives_is_what_was_taken(taken: WorldSnapshot) -> None:
    got = sent(taken)
    assert (got.occupied == taken.occupied).all() and got.size == taken.size
    for name in ("pose_true", "pose_estimated", "goal", "parts", "probabilities", "path"):
        np.testing.assert_allclose(getattr(got, name), getattr(taken, name), atol=1e-5)
    assert got.time == pytest.approx(taken.time)
    for name in ("steps", "episode", "action", "part_names", "scenario", "outcome"):
        assert getattr(got, name) == getattr(taken, name)
    stride = -(-len(taken.scan) // ARRAYS["scan"][0])
    np.testing.assert_allclose(got.scan, taken.scan[::stride], atol=1e-5)
    assert len(got.particles) == len(got.weights) <= ARRAYS["particles"][0]
    assert len(got.pedestrian_position) == 3


def test_a_long_walk_keeps_its_end(taken: WorldSnapshot) -> None:
    path = np.stack([np.arange(901.0), np.zeros(901)], axis=1)
    got = sent(replace(taken, path=path, path_estimated=path))
    assert got.path[-1].tolist() == [900.0, 0.0] and len(got.path) <= ARRAYS["path"][0]


def test_the_grid_comes_now_and_then_and_anew_in_another_place(taken: WorldSnapshot) -> None:
    framer = Framer("run", "actor-0")
    with_grid = [GRID in decode_frame(framer.frame(taken, 1))[1] for _ in range(21)]
    assert [i for i, has in enumerate(with_grid) if has] == [0, 10, 20]
    first = decode_frame(framer.frame(taken, 1))[0].grid_id
    other = replace(taken, occupied=~taken.occupied)
    frame, arrays = decode_frame(framer.frame(other, 1, layout=2))
    assert GRID in arrays and frame.grid_id != first


def test_a_place_that_is_too_large_is_shown_coarser(taken: WorldSnapshot) -> None:
    noise = np.random.default_rng(0).random((1501, 1400)) < 0.02
    large = replace(taken, occupied=noise, resolution=0.05, size=(70.0, 75.05))
    data = Framer("run", "actor-0").frame(large, 1)
    assert len(data) <= FRAME_LIMITS.max_bytes
    frame, arrays = decode_frame(data)
    factor = round(frame.numbers["resolution"] / 0.05)
    grid = grid_of(frame, arrays)
    assert factor in (2, 4) and grid is not None
    assert grid.shape == (1501 // factor, 1400 // factor)
    r, c = (each[5] for each in np.nonzero(noise[:1400, :1400]))
    assert grid[r // factor, c // factor], "what is occupied stays so"
