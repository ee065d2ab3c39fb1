"""Signs and sizes of the six parts, against the formula written out in NumPy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import RewardConfig, TaskConfig
from lndrl.navigation import reward
from lndrl.navigation.actions import action_table

WEIGHTS = reward.reward_weights(RewardConfig())
GOAL = np.array([5.0, 0.0])


def parts(
    true_before,
    estimated_before,
    true,
    estimated,
    variance=(0.0, 0.0, 0.0),
    ends=(False,) * 3,
    limit=np.inf,
) -> dict[str, float]:
    out = np.zeros(6)
    before = np.array([true_before, estimated_before, true_before], np.float64)
    report = np.array([*estimated, *variance, *true], np.float64)
    here, variances = np.array(true, np.float64), np.array(variance, np.float64)
    reward.reward_parts(before, here, report, variances, GOAL, *ends, WEIGHTS, limit, out)
    return dict(zip(reward.REWARD_PARTS, out.tolist(), strict=True))


def test_weights_are_the_papers() -> None:
    assert WEIGHTS.tolist() == [200.0, 400.0, 500.0, -800.0, -500.0, -5.0]


def test_approaching_pays_and_leaving_costs() -> None:
    here, ahead = (0.0, 0.0, 0.0), (0.2, 0.0, 0.0)
    assert parts(here, here, ahead, ahead)["approach"] == pytest.approx(40.0)
    assert parts(ahead, ahead, here, here)["approach"] == pytest.approx(-40.0)


def test_approach_uses_the_truth_and_shrinks_with_variance() -> None:
    here, ahead = (0.0, 0.0, 0.0), (0.2, 0.0, 0.0)
    assert parts(here, here, here, ahead)["approach"] == 0.0  # only believed
    sure = parts(here, here, ahead, ahead)["approach"]
    unsure = parts(here, here, ahead, ahead, variance=(1.0, 20.0, 2.0))["approach"]
    assert unsure == pytest.approx(sure / 24.0)


def test_growing_error_costs_and_shrinking_error_pays() -> None:
    truth = (1.0, 1.0, 0.0)
    near, far = (1.1, 1.0, 0.0), (1.4, 1.0, 0.0)
    assert parts(truth, near, truth, far)["pose"] == pytest.approx(-120.0)
    assert parts(truth, far, truth, near)["pose"] == pytest.approx(120.0)
    turned = (1.0, 1.0, 0.25)
    assert parts(truth, truth, truth, turned)["pose"] == pytest.approx(-100.0)


def test_yaw_error_is_wrapped() -> None:
    a, b = np.array([0.0, 0.0, 3.1]), np.array([0.0, 0.0, -3.1])
    assert reward.angle_error(a, b) == pytest.approx(2 * np.pi - 6.2)
    assert not reward.is_lost(a, b, 2.0, np.pi / 4)


def test_a_limited_pose_error_costs_a_jump_no_more_and_earns_nothing_on_the_way_back() -> None:
    truth, near, middle, far = ((x, 0.0, 0.0) for x in (0.0, 0.1, 0.4, 26.0))
    limit = reward.pose_error_limit(RewardConfig(pose_limit=200.0))
    assert limit == pytest.approx(0.5)
    assert parts(truth, truth, truth, far, limit=limit)["pose"] == pytest.approx(-200.0)
    assert parts(truth, near, truth, middle, limit=limit)["pose"] == pytest.approx(-120.0)
    way = [truth, far, middle, near, truth]
    steps = itertools.pairwise(way)
    round_trip = sum(parts(truth, a, truth, b, limit=limit)["pose"] for a, b in steps)
    assert round_trip == pytest.approx(0.0)
    # Of the other sign of k_p, and of none.
    assert reward.pose_error_limit(RewardConfig(pose=-100.0, pose_limit=50.0)) == 0.5
    assert reward.pose_error_limit(RewardConfig(pose=0.0, pose_limit=50.0)) == np.inf
    assert reward.pose_error_limit(RewardConfig()) == np.inf


def test_ends_pay_independently_and_every_step_costs() -> None:
    here = (0.0, 0.0, 0.0)
    nothing = parts(here, here, here, here)
    assert nothing == dict(approach=0, pose=0, arrive=0, collide=0, lost=0, step=-5)
    assert parts(here, here, here, here, ends=(True, False, False))["arrive"] == 500.0
    assert parts(here, here, here, here, ends=(False, True, False))["collide"] == -800.0
    assert parts(here, here, here, here, ends=(False, False, True))["lost"] == -500.0
    assert parts(here, here, here, here, ends=(True, True, True))["step"] == -5.0


def test_a_report_is_judged_by_the_truth_beside_it_and_measured_by_the_present_one() -> None:
    before = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    report = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    now = np.array([2.5, 0.0, 1.0])
    parts, sums = np.zeros(6), np.zeros(9)
    limits = (2.0, 0.785, 0.5, np.inf)
    _, lost, _ = reward.judge(
        before, now, report, np.zeros(3), GOAL, False, limits, WEIGHTS, parts, sums
    )
    assert not lost  # though 2.2 m and 1 rad lie between what is heard and where it is
    assert parts[1] == pytest.approx(-400.0 * 0.1)
    assert sums[6:8] == pytest.approx([2.2, 1.0])
    report[0] = 2.2
    assert reward.judge(
        before, now, report, np.zeros(3), GOAL, False, limits, WEIGHTS, parts, sums
    )[1]


def test_thresholds() -> None:
    origin = np.zeros(3)
    assert not reward.is_lost(origin, np.array([2.0, 0.0, 0.0]), 2.0, 0.785)
    assert reward.is_lost(origin, np.array([2.001, 0.0, 0.0]), 2.0, 0.785)
    assert reward.is_lost(origin, np.array([0.0, 0.0, -0.8]), 2.0, 0.785)
    assert reward.has_arrived(np.array([4.51, 0.0, 0.0]), GOAL, 0.5)
    assert not reward.has_arrived(np.array([4.5, 0.0, 0.0]), GOAL, 0.5)


finite = st.floats(-20.0, 20.0)
pose = st.tuples(finite, finite, st.floats(-3.1, 3.1))


@settings(max_examples=60, deadline=None)
@given(
    pose,
    pose,
    pose,
    pose,
    st.tuples(*[st.floats(0.0, 100.0)] * 3),
    st.sampled_from((np.inf, 0.5, 3.0)),
)
def test_matches_the_formula(tb, eb, t, e, variance, limit) -> None:
    tb_, eb_, t_, e_ = (np.array(p) for p in (tb, eb, t, e))

    def error(truth: np.ndarray, estimate: np.ndarray) -> float:
        d = truth - estimate
        d[2] = np.arctan2(np.sin(d[2]), np.cos(d[2]))
        return float(min(np.linalg.norm(d), limit))

    got = parts(tb, eb, t, e, variance, limit=limit)
    approach = np.linalg.norm(tb_[:2] - GOAL) - np.linalg.norm(t_[:2] - GOAL)
    assert got["approach"] == pytest.approx(200.0 * approach / (1.0 + sum(variance)), abs=1e-9)
    assert got["pose"] == pytest.approx(400.0 * (error(tb_, eb_) - error(t_, e_)), abs=1e-6)


def test_action_table() -> None:
    table = action_table(TaskConfig())
    assert table.shape == (28, 2)
    assert table[0].tolist() == [0.0, -0.9] and table[3].tolist() == [0.0, 0.0]
    assert table[6].tolist() == [0.0, 0.9] and table[7].tolist() == [0.2, -0.9]
    assert table[27].tolist() == [0.6, 0.9]
    assert len({tuple(row) for row in table.tolist()}) == 28
