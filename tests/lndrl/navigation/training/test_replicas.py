"""Replicas of the filter: the robot goes on as without them, and they get lost as often as it."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from lndrl.config import ReplicaConfig, RunConfig, load_config, parse_config
from lndrl.errors import UserError
from lndrl.models import effective
from lndrl.navigation import StepResult, VectorNavigation
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.navigation.terms import as_tested

LOST = REWARD_PARTS.index("lost")
SCENARIO = {
    "name": "small",
    "size": [9.0, 9.0],
    "pedestrians": {
        "count": [3, 3],
        "routes": [{"start": [1, 6, 2, 8], "goal": [7, 6, 8, 8]}],
    },
    "robot": [{"start": [3, 3, 4, 4], "goal": [7, 7, 8, 8]}],
}


def made_config(count: int = 0, lost: float = 0.0, **further: Any) -> RunConfig:
    data = {
        "scenario": SCENARIO,
        "seed": 5,
        "localization": {"min_particles": 60, "max_particles": 100, "delay": 2},
        **further,
    }
    data["world"] = {"odometry_deviation": 0.4, **further.get("world", {})}
    if count:
        data["replicas"] = {"count": count, "lost": lost}
    return parse_config(data, "test")


def circling(vector: VectorNavigation, steps: int) -> list[StepResult]:
    """Round and round, which a filter does not stand for long."""
    velocities = np.tile([0.2, 0.9], (len(vector), 1))
    return [vector.step_velocities(velocities) for _ in range(steps)]


@pytest.mark.parametrize("draw", ["step", "reading"])
def test_the_robot_does_not_hear_of_them(draw: str) -> None:
    world = {"odometry_draw": draw}
    alone = VectorNavigation(made_config(world=world), 0, 3, privileged=True)
    beside = VectorNavigation(made_config(4, -400.0, world=world), 0, 3, privileged=True)
    paid = 0.0
    for one, other in zip(circling(alone, 200), circling(beside, 200), strict=True):
        np.testing.assert_array_equal(one.terminated, other.terminated)
        rest = [part for part in range(len(REWARD_PARTS)) if part != LOST]
        np.testing.assert_array_equal(one.parts[:, rest], other.parts[:, rest])
        more = other.parts[:, LOST] - one.parts[:, LOST]
        np.testing.assert_allclose(other.reward - one.reward, more, atol=1e-3)
        assert np.all(np.isin(more, -100.0 * np.arange(5)))
        paid += more.sum()
    np.testing.assert_array_equal(alone.privileged, beside.privileged)
    assert paid < -1000.0


def test_they_get_lost_as_often_as_the_robot() -> None:
    vector = VectorNavigation(made_config(4, -4.0, task={"reward": {"lost": -1000.0}}), 0, 24)
    own = theirs = 0.0
    for result in circling(vector, 500):
        lost = result.parts[:, LOST]
        own += (lost <= -1000.0).sum()
        theirs -= (lost + 1000.0 * (lost <= -1000.0)).sum()
    # Some 300 and 1,200 events: their ratio has a deviation of 0.06, or 0.07 with what replicas of
    # one drive share.
    assert own > 150
    assert theirs / 4.0 / own == pytest.approx(1.0, abs=0.3)


def test_they_differ_from_the_robot_and_from_one_another() -> None:
    vector = VectorNavigation(made_config(3), 0, 2)
    circling(vector, 3)
    world = vector.worlds[0]
    poses = [world.localization.pose_estimated, *world.batch.replicas.beliefs.pose[0]]
    assert len({tuple(pose) for pose in poses}) == 4
    odometry = [world.world.pose_odometry, *world.batch.replicas.odometry[0]]
    assert len({tuple(pose) for pose in odometry}) == 4


def test_their_particles_are_their_own_where_wheels_do_not_slip() -> None:
    vector = VectorNavigation(made_config(3, world={"odometry_deviation": 0.0}), 0, 1)
    circling(vector, 3)
    replicas = vector.worlds[0].batch.replicas
    assert len({tuple(pose) for pose in replicas.odometry[0]}) == 1
    assert len({tuple(pose) for pose in replicas.beliefs.pose[0]}) == 3


def test_one_that_is_lost_takes_up_the_belief_of_the_robot() -> None:
    vector = VectorNavigation(made_config(2, -200.0), 0, 1)
    world = vector.worlds[0]
    replicas = world.batch.replicas
    vector.step_velocities(np.array([[0.3, 0.0]]))
    replicas.beliefs.pose[0, 1] += 3.0
    replicas.beliefs.particles[0, 1, :, :2] += 3.0
    result = vector.step_velocities(np.array([[0.0, 0.0]]))  # too little moves for an update
    assert result.parts[0, LOST] == -100.0
    np.testing.assert_array_equal(replicas.beliefs.pose[0, 1], world.localization.pose_estimated)
    np.testing.assert_array_equal(replicas.odometry[0, 1], world.world.pose_odometry)
    assert np.any(replicas.beliefs.pose[0, 0] != world.localization.pose_estimated)
    assert vector.step_velocities(np.array([[0.3, 0.0]])).parts[0, LOST] == 0.0


@pytest.mark.parametrize("count", [0, 3])
def test_the_chance_of_getting_lost_is_paid_as_headings_tell_it(count: int) -> None:
    price = -3600.0
    unpaid = VectorNavigation(made_config(task={"reward": {"lost": 0.0}}), 0, 2)
    paying = made_config(replicas={"count": count, "risk": price}, task={"reward": {"lost": 0.0}})
    vector = VectorNavigation(paying, 0, 2)
    batch, seen = vector.worlds[0].batch, 0
    for _ in range(60):
        (own,), (paid,) = circling(unpaid, 1), circling(vector, 1)
        more = paid.parts[:, LOST] - own.parts[:, LOST]
        np.testing.assert_allclose(paid.reward - own.reward, more, atol=1e-3)
        for world in np.flatnonzero(~paid.terminated):  # whose filters are not new ones
            yaws = [batch.beliefs.pose[world, 2], *batch.replicas.beliefs.pose[world, :, 2]]
            error = np.abs(np.angle(np.exp(1j * (batch.world.robots.pose[world, 2] - yaws))))
            # (e / 0.23 rad)^3 of the filters are lost within 12 steps. One that is lost has already
            # taken up the robot's belief, which says another chance.
            chance = np.minimum((error / 0.23) ** 3, 1.0) / 12.0
            if count == 0 or more[world] > 0.9 * price / (count + 1) / 12.0:
                assert more[world] == pytest.approx(price * chance.mean(), rel=1e-5, abs=1e-6)
                seen += chance.max() > 1e-4
    assert seen > 10


def test_worlds_do_not_depend_on_one_another_and_repeat() -> None:
    def rewards(first: int, worlds: int, world: int) -> list[float]:
        vector = VectorNavigation(made_config(3, -900.0), first, worlds)
        return [float(result.reward[world]) for result in circling(vector, 120)]

    assert rewards(2, 3, 1) == rewards(3, 1, 0)


def test_a_copy_and_a_second_try_go_on() -> None:
    config = made_config(3, -900.0, retry={"most": 2, "back": [3, 8], "every": 2, "past": 4})
    vector = VectorNavigation(config, 0, 2)
    circling(vector, 60)
    copy = pickle.loads(pickle.dumps(vector))
    for ours, theirs in zip(circling(vector, 80), circling(copy, 80), strict=True):
        np.testing.assert_array_equal(ours.reward, theirs.reward)


def test_a_true_pose_has_none() -> None:
    vector = VectorNavigation(made_config(3, -900.0, localization="perfect"), 0, 1)
    assert all(result.parts[0, LOST] == 0.0 for result in circling(vector, 50))
    config = made_config(localization="perfect", replicas={"count": 2, "risk": -900.0})
    assert all(result.parts[0, LOST] == 0.0 for result in circling(VectorNavigation(config), 50))


def test_tests_have_none_and_the_default_neither() -> None:
    assert as_tested(made_config(2, -10.0)).replicas == ReplicaConfig()
    assert "replicas" not in effective(load_config("lndrl"))


@pytest.mark.parametrize(
    ("replicas", "sentence"),
    [
        ({"lost": -3000.0}, "there are none; set replicas.count"),
        ({"count": -1}, "greater than or equal to 0"),
        ({"count": 65}, "less than or equal to 64"),
    ],
)
def test_what_cannot_be_is_refused(replicas: dict[str, float], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        parse_config({"scenario": SCENARIO, "replicas": replicas}, "test")
