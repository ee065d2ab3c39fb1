import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.randomness import stream_state
from lndrl.world.odometry import draw_slip, drive, move_robot, wrap

angles = st.floats(-3.0, 3.0)


@given(st.floats(-1, 1), st.floats(0.05, 2.0), st.sampled_from([-1, 1]), angles)
def test_drive_is_the_unicycle_arc_in_closed_form(v, w, sign, yaw):
    w *= sign
    pose = np.array([1.0, -2.0, yaw])
    drive(pose, v, w, 0.4)
    turned = yaw + 0.4 * w
    assert pose[0] == pytest.approx(1.0 + v / w * (np.sin(turned) - np.sin(yaw)), abs=1e-9)
    assert pose[1] == pytest.approx(-2.0 - v / w * (np.cos(turned) - np.cos(yaw)), abs=1e-9)
    assert np.cos(pose[2] - turned) == pytest.approx(1.0)


def test_straight_and_almost_straight_agree():
    a, b = np.array([0.0, 0.0, 0.7]), np.array([0.0, 0.0, 0.7])
    drive(a, 0.6, 0.0, 0.1)
    drive(b, 0.6, 1e-8, 0.1)
    assert a == pytest.approx(b, abs=1e-9)
    assert a[:2] == pytest.approx([0.06 * np.cos(0.7), 0.06 * np.sin(0.7)])


@given(st.floats(-50, 50))
def test_wrap_is_half_open_at_pi(angle):
    wrapped = wrap(angle)
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped - angle) == pytest.approx(1.0)


def test_wrap_of_pi_is_minus_pi():
    assert wrap(np.pi) == -np.pi
    assert wrap(np.nextafter(-np.pi, -4.0)) < np.pi


def test_slip_has_mean_one_and_the_given_deviation_and_is_independent():
    state = stream_state(3)
    slip = np.ones(2)
    draws = np.empty((20_000, 2))
    for i in range(len(draws)):
        draw_slip(slip, 0.1, state)
        draws[i] = slip
    assert draws.mean(axis=0) == pytest.approx([1.0, 1.0], abs=0.003)
    assert draws.std(axis=0) == pytest.approx([0.1, 0.1], rel=0.03)
    assert abs(np.asarray(np.corrcoef(draws.T))[0, 1]) < 0.03


def test_odometer_integrates_the_slipped_command_and_the_robot_the_true_one():
    pose, odometry = np.array([2.0, 3.0, 1.0]), np.zeros(3)
    move_robot(pose, odometry, np.array([0.5, 0.4]), np.array([1.2, 0.5]), 0.1)
    want, slipped = np.array([2.0, 3.0, 1.0]), np.zeros(3)
    drive(want, 0.5, 0.4, 0.1)
    drive(slipped, 0.6, 0.2, 0.1)
    assert (pose == want).all()
    assert odometry == pytest.approx(slipped, abs=1e-12)
