"""The small picture: where things land in it."""

from __future__ import annotations

import pickle

import numpy as np

from lndrl.navigation.environment.render import (
    ESTIMATE,
    FLOOR,
    GOAL,
    LEG,
    PARTICLE,
    ROBOT,
    SCAN,
    WALL,
    render_snapshot,
)
from lndrl.navigation.snapshot import WorldSnapshot


def made_snapshot(**changes) -> WorldSnapshot:
    occupied = np.zeros((80, 120), np.bool_)
    occupied[:2] = True  # a wall along y = 0
    fields = dict(
        scenario="made",
        size=(6.0, 4.0),
        occupied=occupied,
        resolution=0.05,
        origin=(0.0, 0.0),
        world=0,
        episode=0,
        steps=1,
        time=0.4,
        outcome="",
        pose_true=np.array([2.0, 2.0, 0.0]),
        pose_estimated=np.array([3.0, 3.0, 0.0]),
        variance=np.zeros(3),
        particles=np.array([[0.5, 3.5, 0.0]]),
        start_pose=np.zeros(3),
        goal=np.array([5.0, 1.0]),
        arrive_distance=0.5,
        command=np.zeros(2),
        scan=np.full(720, 12.0, np.float32),
        field_of_view=np.pi,
        range_max=12.0,
        pedestrian_position=np.array([[1.0, 1.0]]),
        pedestrian_velocity=np.zeros((1, 2)),
        leg_position=np.array([[1.0, 0.9], [1.0, 1.1]]),
        pedestrian_radius=0.3,
        leg_radius=0.1,
        robot_radius=0.17,
        path=np.array([[1.5, 2.0], [2.0, 2.0]]),
        path_estimated=np.array([[1.5, 2.0], [3.0, 3.0]]),
        episode_return=0.0,
    )
    return WorldSnapshot(**{**fields, **changes})


def centre_of(image: np.ndarray, color: tuple[int, int, int]) -> tuple[float, float]:
    """Map coordinates (m) of the mean pixel of ``color`` at 20 pixels per metre."""
    row, column = np.nonzero((image == color).all(axis=-1))
    assert len(row), f"nothing drawn in {color}"
    return (column.mean() + 0.5) / 20, (image.shape[0] - row.mean() - 0.5) / 20


def test_everything_stands_where_it_is() -> None:
    image = render_snapshot(made_snapshot())
    assert image.shape == (80, 120, 3) and image.dtype == np.uint8
    assert (image[-1] == WALL).all() and (image[0, 0] == FLOOR).all()
    for color, expected in [(GOAL, (5, 1)), (LEG, (1, 1)), (PARTICLE, (0.5, 3.5))]:
        assert np.allclose(centre_of(image, color), expected, atol=0.1)
    assert np.allclose(centre_of(image, ROBOT), (2.05, 2), atol=0.1)
    assert np.allclose(centre_of(image, ESTIMATE), (3.15, 3), atol=0.1)
    assert not (image == SCAN).all(axis=-1).any()  # no echo anywhere


def test_echoes_lie_ahead() -> None:
    image = render_snapshot(made_snapshot(scan=np.full(720, 1.0, np.float32)))
    x, y = centre_of(image, SCAN)
    assert 2.3 < x < 2.9 and abs(y - 2.0) < 0.15


def test_things_outside_are_left_out() -> None:
    far = np.array([-30.0, 90.0, 1.0])
    image = render_snapshot(
        made_snapshot(pose_true=far, pose_estimated=far, goal=far[:2], particles=far[None])
    )
    assert not (image == ROBOT).all(axis=-1).any() and not (image == GOAL).all(axis=-1).any()


def test_snapshot_is_picklable() -> None:
    again = pickle.loads(pickle.dumps(made_snapshot()))
    assert np.array_equal(render_snapshot(again), render_snapshot(made_snapshot()))
