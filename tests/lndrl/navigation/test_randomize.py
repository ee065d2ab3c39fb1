"""Settings that are drawn anew for every episode of training, and never in tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lndrl.config import RandomizeConfig, RunConfig, load_config, parse_config
from lndrl.errors import UserError
from lndrl.evaluation import EpisodeRunner
from lndrl.evaluation.benchmark import Contender, bench_config
from lndrl.models import effective
from lndrl.navigation import VectorNavigation
from lndrl.navigation.terms import as_tested
from lndrl.planners import PlannerSource

SCENARIO = {
    "name": "small",
    "size": [9.0, 6.0],
    "pedestrians": {"count": [0, 0]},
    "robot": [{"start": [1, 1, 2, 5], "goal": [7, 1, 8, 5]}],
}
TURNING = np.array([[0.4, 0.9], [0.4, -0.9], [0.6, 0.3]])


def made_config(**randomize: Any) -> RunConfig:
    data = {
        "scenario": SCENARIO,
        "seed": 5,
        "localization": {"min_particles": 60, "max_particles": 100},
        "randomize": randomize,
    }
    return parse_config(data, "test")


def slips(navigation: VectorNavigation, episodes: int) -> np.ndarray:
    """Deviation of every world's slip, episode by episode."""
    found = []
    for episode in range(episodes):
        for world in navigation.worlds:
            world.reset(episode)
        found.append([world.world.robot.deviation[0] for world in navigation.worlds])
    return np.array(found)


def test_slip_is_drawn_evenly_for_every_episode_of_every_world() -> None:
    config = made_config(odometry_deviation=[0.05, 0.15])
    drawn = slips(VectorNavigation(config, 0, 3), 100)
    assert 0.05 <= drawn.min() < 0.06 and 0.14 < drawn.max() <= 0.15
    assert len(np.unique(drawn)) == 300
    assert drawn.mean() == pytest.approx(0.1, abs=0.01)
    np.testing.assert_array_equal(slips(VectorNavigation(config, 0, 3), 100), drawn)
    # What it is drawn from is the world's own: who else runs beside it changes nothing.
    np.testing.assert_array_equal(slips(VectorNavigation(config, 0, 1), 100)[:, 0], drawn[:, 0])
    assert (slips(VectorNavigation(made_config(), 0, 3), 5) == 0.1).all()


def test_the_filters_noise_is_scaled_as_a_whole() -> None:
    navigation = VectorNavigation(made_config(motion_noise=[0.5, 2.0]), 0, 2)
    config = navigation.worlds[0].config.localization
    settings = np.array([getattr(config, f"odom_alpha{k}") for k in (1, 2, 3, 4)])
    factors = []
    for episode in range(100):
        for world in navigation.worlds:
            world.reset(episode)
            ratio = world.batch.beliefs.alpha[world.index] / settings
            assert ratio == pytest.approx(ratio[0])
            factors.append(ratio[0])
    logarithms = np.log2(factors)
    assert -1.0 <= logarithms.min() < -0.9 and 0.9 < logarithms.max() <= 1.0
    assert logarithms.mean() == pytest.approx(0.0, abs=0.15)


def driven(config: RunConfig) -> list[np.ndarray]:
    """Poses of the truth, the odometer and the estimate after five steps in three worlds."""
    navigation = VectorNavigation(config, 0, 3)
    for _ in range(5):
        navigation.step_velocities(TURNING)
    robots, beliefs = navigation.worlds[0].batch.world.robots, navigation.worlds[0].batch.beliefs
    return [robots.pose.copy(), robots.odometry.copy(), beliefs.pose.copy()]


def test_what_is_drawn_is_what_wheels_and_filter_do() -> None:
    plain = driven(made_config())
    same = driven(made_config(odometry_deviation=[0.1, 0.1], motion_noise=[1.0, 1.0]))
    for one, other in zip(plain, same, strict=True):
        np.testing.assert_array_equal(one, other)
    slipping = driven(made_config(odometry_deviation=[0.3, 0.3]))
    np.testing.assert_array_equal(slipping[0], plain[0])
    assert not np.isclose(slipping[1], plain[1]).any(axis=0)[:2].all()
    # The odometer's error is three times as large in each world's first step.
    firm = VectorNavigation(made_config(odometry_deviation=[0.0, 0.0]), 0, 3)
    errors = []
    for deviation in (0.1, 0.3):
        loose = VectorNavigation(made_config(odometry_deviation=[deviation] * 2), 0, 3)
        loose.step_velocities(TURNING)
        errors.append(loose.worlds[0].batch.world.robots.slip - 1.0)
    np.testing.assert_allclose(errors[1], 3.0 * errors[0])
    firm.step_velocities(TURNING)
    assert (firm.worlds[0].batch.world.robots.slip == 1.0).all()
    noisy = driven(made_config(motion_noise=[9.0, 9.0]))
    np.testing.assert_array_equal(noisy[1], plain[1])
    assert not np.array_equal(noisy[2], plain[2])


def test_a_key_does_not_change_what_the_other_one_draws() -> None:
    alone = slips(VectorNavigation(made_config(odometry_deviation=[0.0, 1.0]), 0, 2), 3)
    both = made_config(odometry_deviation=[0.0, 1.0], motion_noise=[0.5, 2.0])
    np.testing.assert_array_equal(slips(VectorNavigation(both, 0, 2), 3), alone)


def test_tests_and_the_bench_never_randomize() -> None:
    wild = made_config(odometry_deviation=[0.5, 0.9], motion_noise=[5.0, 9.0])
    assert as_tested(wild).randomize == RandomizeConfig()
    source = PlannerSource("straight")
    tested, plain = (
        list(EpisodeRunner(source, config)(range(3))) for config in (wild, made_config())
    )
    assert tested == plain
    trained = PlannerSource("run", config=wild)
    config = bench_config(Contender("run", trained, "amcl"), "hybrid", 0)
    assert config.randomize == RandomizeConfig()


def test_it_is_off_and_out_of_the_hash_unless_it_is_set() -> None:
    for name in ("paper", "lndrl"):
        config = load_config(name)
        assert config.randomize == RandomizeConfig()
        assert "randomize" not in effective(config)
    assert "randomize" in effective(made_config(motion_noise=[0.5, 2.0]))


@pytest.mark.parametrize(
    ("randomize", "sentence"),
    [
        ({"odometry_deviation": [0.2, 0.1]}, r"\[0.2, 0.1\] must name the least first"),
        ({"motion_noise": [0.0, 1.0]}, "greater than 0"),
        ({"motion_noise": [1.0]}, "randomize.motion_noise"),
    ],
)
def test_what_is_no_range_is_refused(randomize: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        made_config(**randomize)
