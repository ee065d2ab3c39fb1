"""One episode at a time: what is seen, how it ends, what is recorded, and bit-equal replay."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from lndrl import localization
from lndrl.config import RunConfig
from lndrl.navigation.environment.render import render_snapshot
from lndrl.navigation.navigation import Navigation, Transition, build_surroundings
from lndrl.navigation.observation import goal_vector
from lndrl.navigation.reward import pose_error
from lndrl.randomness import Stream, episode_states
from lndrl.world import World, beam_bearings

SCENARIO = {
    "name": "small",
    "size": [14.0, 10.0],
    "obstacles": [{"box": [6.0, 7.0, 7.0, 8.0]}],
    "pedestrians": {
        "count": [4, 6],
        "routes": [{"start": [3.0, 6.0, 5.0, 9.0], "goal": [9.0, 6.0, 12.0, 9.0]}],
    },
    "robot": [{"start": [1.5, 1.5, 2.5, 2.5], "goal": [11.0, 2.0, 12.0, 3.0]}],
}


def made_config(**changes) -> RunConfig:
    data = {
        "seed": 5,
        "scenario": SCENARIO,
        "localization": {"min_particles": 60, "max_particles": 200},
    }
    return RunConfig.model_validate({**data, **changes})


AMCL = made_config()
PERFECT = made_config(localization={"kind": "perfect"})
LATE = made_config(localization={"min_particles": 60, "max_particles": 200, "delay": 2})
SURROUNDINGS = build_surroundings(AMCL)


def started(config: RunConfig = AMCL, world: int = 0, episode: int | None = None) -> Navigation:
    made = Navigation(*SURROUNDINGS, config, world)
    made.reset(episode)
    return made


def bits(navigation: Navigation) -> bytes:
    row = navigation.observation
    arrays = (row.scan, row.pedestrians, row.pedestrian_count, row.goal, navigation.world.pose_true)
    return b"".join(a.tobytes() for a in arrays)


def drive(navigation: Navigation, steps: int) -> list[tuple[bytes, float]]:
    """A fixed dance around the start; ends early when the episode does."""
    seen = [(bits(navigation), 0.0)]
    for i in range(steps):
        transition = navigation.step(0.2, 0.9 if i % 8 < 4 else -0.9)
        seen.append((bits(navigation), transition.reward))
        if transition.record:
            break
    return seen


def test_replay_is_bit_equal_whatever_else_runs() -> None:
    alone = drive(started(episode=3), 12)
    other = started(world=1)
    beside = started(episode=0)
    drive(beside, 2)
    other.step(0.2, 0.3)
    beside.reset(3)
    assert drive(beside, 12) == alone
    assert len(alone) > 5


def test_other_worlds_episodes_and_seeds_differ() -> None:
    starts = {
        bits(started(config, world, episode))
        for config in (AMCL, AMCL.model_copy(update={"seed": 6}))
        for world in (0, 1)
        for episode in (0, 1)
    }
    assert len(starts) == 8


def test_reset_observes_the_start() -> None:
    navigation = started()
    row, world = navigation.observation, navigation.world
    assert row.shape == () and row.scan.any()
    distance = np.hypot(*(world.goal - world.start_pose[:2]))
    assert np.hypot(row.goal[0], row.goal[1]) == pytest.approx(distance, abs=0.1)
    assert abs(row.goal[2]) < 0.05  # faces the goal's yaw, but for the initial doubt
    assert (row.goal[3:] > 0).all()
    assert navigation.steps == 0 and navigation.episode == 0
    navigation.reset()
    assert navigation.episode == 1


def test_goal_in_robot_with_perfect_localization() -> None:
    navigation = started(PERFECT)
    world = navigation.world
    navigation.step(0.2, 0.6)
    x, y, yaw = world.pose_true
    dx, dy = world.goal - (x, y)
    expected = [
        math.cos(yaw) * dx + math.sin(yaw) * dy,
        math.cos(yaw) * dy - math.sin(yaw) * dx,
        -0.24,
    ]
    np.testing.assert_allclose(navigation.observation.goal[:3], expected, atol=1e-5)
    assert not navigation.observation.goal[3:].any()


def test_goal_never_depends_on_the_truth() -> None:
    navigation = started()
    navigation.step(0.2, 0.3)
    before = navigation.observation.copy()
    navigation.world.pose_true += [1.0, -0.7, 0.8]
    navigation.batch.observe(0)
    np.testing.assert_array_equal(navigation.observation.goal, before.goal)
    navigation.localization.pose_estimated[:] += [0.5, 0.0, 0.1]
    navigation.batch.observe(0)
    assert np.abs(navigation.observation.goal[:3] - before.goal[:3]).max() > 0.05


def test_people_are_seen_relative_to_the_true_robot() -> None:
    navigation = started()
    world = navigation.world
    world.pose_true[:] = [*(world.pedestrian_position[0] - [1.0, 0.0]), 0.0]
    navigation.localization.pose_estimated[:] += 5.0
    navigation.batch.observe(0)
    rows = navigation.observation.pedestrians[: int(navigation.observation.pedestrian_count)]
    expected = [1.0, 0.0, *world.pedestrian_velocity[0]]
    assert np.abs(rows - expected).max(axis=1).min() < 1e-6


def test_a_compiled_step_is_its_parts_one_after_the_other() -> None:
    """The slow twin: world and filter called from Python, tick by tick."""
    navigation = started(episode=2)
    place, field = SURROUNDINGS
    world = World(place, AMCL.world)
    filter_ = localization.AMCL(field, AMCL.localization, AMCL.world.laser)
    bearings = beam_bearings(AMCL.world.laser)[::12].astype(np.float32)
    states = episode_states(AMCL.seed, 0, 2)
    world.reset(AMCL.seed, 0, 2)
    filter_.reset(world.start_pose, states[Stream.LOCALIZATION])
    scan = world.scan()
    filter_.update(world.pose_odometry, scan[::12], bearings)
    for v, w in [(0.4, 0.3), (0.2, -0.9), (0.0, 0.0), (0.2, 0.9), (0.4, 0.0)]:
        assert navigation.step(v, w).record is None
        world.begin_step(v, w)
        for _ in range(3):
            world.tick()
            filter_.update(world.pose_odometry, world.scan_sparse(12), bearings)
        world.tick()
        scan = world.scan()
        filter_.update(world.pose_odometry, scan[::12], bearings)
        np.testing.assert_array_equal(navigation.scan, scan)
        for ours, twins in [
            (navigation.world.pose_true, world.pose_true),
            (navigation.world.pose_odometry, world.pose_odometry),
            (navigation.world.pedestrian_position, world.pedestrian_position),
            (navigation.world.leg_position, world.leg_position),
            (navigation.localization.pose_estimated, filter_.pose_estimated),
            (navigation.localization.covariance, filter_.covariance),
            (navigation.localization.particles, filter_.particles),
            (navigation.track.variance, filter_.variance),
        ]:
            np.testing.assert_array_equal(ours, twins)
    assert navigation.world.time == pytest.approx(2.0)


class Script:
    """A navigation whose steps end with what the test tells it."""

    def __init__(self, collide=False, offset=(0.0, 0.0, 0.0), at_goal=False) -> None:
        self.navigation = navigation = started(PERFECT)
        world = navigation.world
        drive = navigation._drive

        def scripted(v: float, w: float) -> None:
            drive(v, w)
            world.robot.contact[0] = 1 if collide else 0
            navigation.localization.pose_estimated[:] = world.pose_true + np.array(offset)

        navigation._drive = scripted  # type: ignore[method-assign]
        if at_goal:
            world.goal[:] = world.pose_true[:2] + np.array(offset[:2]) + [0.2, 0.2]

    def step(self) -> Transition:
        return self.navigation.step(0.0, 0.0)


@pytest.mark.parametrize(
    "told, outcome, paid",
    [
        (dict(collide=True), "collided", {"collide": -800.0}),
        (dict(offset=(2.1, 0.0, 0.0)), "lost", {"lost": -500.0}),
        (dict(offset=(0.0, 0.0, -0.8)), "lost", {"lost": -500.0}),
        (dict(at_goal=True), "arrived", {"arrive": 500.0}),
        (dict(offset=(1.9, 0.0, 0.7), at_goal=True), "arrived", {"arrive": 500.0}),
        (
            dict(collide=True, offset=(0.0, 2.5, 0.0), at_goal=True),
            "collided",
            {"collide": -800.0, "lost": -500.0, "arrive": 500.0},
        ),
        (
            dict(offset=(0.0, 2.5, 0.0), at_goal=True),
            "lost",
            {"lost": -500.0, "arrive": 500.0},
        ),
    ],
)
def test_ends_and_their_order(told: dict, outcome: str, paid: dict[str, float]) -> None:
    script = Script(**told)
    transition = script.step()
    assert transition.terminated and not transition.truncated
    record = transition.record
    assert record is not None and record.outcome == outcome and record.steps == 1
    for part in ("collide", "lost", "arrive"):
        assert record.reward_parts[part] == paid.get(part, 0.0)
    assert transition.reward == pytest.approx(sum(record.reward_parts.values()))
    assert record.episode_return == pytest.approx(transition.reward)
    assert script.navigation.snapshot().outcome == outcome
    with pytest.raises(RuntimeError, match="reset"):
        script.step()


def test_being_at_the_goal_without_believing_it_is_no_arrival() -> None:
    script = Script(offset=(1.5, 0.0, 0.0))
    script.navigation.world.goal[:] = script.navigation.world.pose_true[:2]
    assert script.step().record is None


def test_collision_ends_the_step_at_once() -> None:
    navigation = started(PERFECT)
    world = navigation.world
    # 0.06 m a tick: the first of four leaves 0.01 m, the second touches the outer wall.
    world.pose_true[:] = [14.0 - 0.1 - 0.17 - 0.07, 5.0, 0.0]
    world.people.count[0] = 0
    record = navigation.step(0.6, 0.0).record
    assert record is not None and record.outcome == "collided"
    assert world.collided_with == "wall"
    assert record.time == pytest.approx(0.2) and record.distance == pytest.approx(0.12)
    assert navigation.scan[360] == pytest.approx(0.12, abs=0.1)  # taken where it happened


def test_time_limit_truncates() -> None:
    navigation = started(made_config(localization={"kind": "perfect"}, task={"time_limit": 1.0}))
    assert navigation.steps_limit == 3
    assert [navigation.step(0.0, 0.3).record for _ in range(2)] == [None, None]
    transition = navigation.step(0.0, 0.3)
    assert transition.truncated and not transition.terminated
    assert transition.record is not None and transition.record.outcome == "timeout"
    assert transition.record.time == pytest.approx(1.2)


def test_record_measures_the_true_path_and_mean_errors() -> None:
    navigation = started(made_config(localization={"kind": "perfect"}, task={"time_limit": 1.6}))
    drive = navigation._drive

    def misled(v: float, w: float) -> None:
        drive(v, w)
        navigation.localization.pose_estimated[:] += [0.3, 0.4, -0.1]

    navigation._drive = misled  # type: ignore[method-assign]
    for _ in range(4):
        record = navigation.step(0.2, 0.9).record
    assert record is not None
    assert record.distance == pytest.approx(0.32, abs=1e-3)
    assert record.position_error == pytest.approx(0.5)
    assert record.angle_error == pytest.approx(0.1)
    assert record.variance_sum == 0.0
    assert record.reward_parts["pose"] == pytest.approx(-400 * math.hypot(0.5, 0.1))
    assert record.reward_parts["step"] == -20.0


def test_driving_to_the_goal_pays() -> None:
    navigation = started(PERFECT)
    world = navigation.world
    dx, dy = world.goal - world.pose_true[:2]
    world.pose_true[2] = math.atan2(dy, dx)
    toward = navigation.step(0.6, 0.0)
    assert toward.parts[0] == pytest.approx(200 * 0.24, rel=0.01)
    world.pose_true[2] += math.pi
    assert navigation.step(0.6, 0.0).parts[0] < -40


def test_snapshot_shares_nothing_and_draws() -> None:
    navigation = started()
    navigation.step(0.2, 0.3)
    before = navigation.snapshot()
    kept = pickle.dumps(before)
    navigation.step(0.2, 0.3)
    assert pickle.dumps(before) == kept
    after = navigation.snapshot()
    assert after.path.shape == after.path_estimated.shape == (3, 2)
    np.testing.assert_array_equal(after.path[-1], after.pose_true[:2])
    assert after.scan.shape == (720,) and after.particles.shape[1] == 3
    assert len(after.leg_position) == 2 * len(after.pedestrian_position) >= 8
    assert render_snapshot(after).shape == (200, 280, 3)


def test_a_place_without_people() -> None:
    scenario = {**SCENARIO, "pedestrians": {"count": [0, 0]}}
    config = made_config(scenario=scenario)
    navigation = Navigation(*build_surroundings(config), config, 0)
    navigation.reset()
    navigation.step(0.2, 0.0)
    assert navigation.observation.pedestrian_count == 0
    assert not navigation.observation.pedestrians.any()
    assert navigation.snapshot().leg_position.shape == (0, 2)


def test_three_scans_are_those_of_three_steps_and_nothing_else_changes() -> None:
    task = {"scan_frames": 3}
    three = started(made_config(task=task, network={"scan_encoder": "fan"}))
    one = started()
    beams = AMCL.world.laser.beams
    seen = [one.observation.scan.copy()] * 3
    for _ in range(4):
        np.testing.assert_array_equal(three.observation.scan, np.concatenate(seen[-3:]))
        np.testing.assert_array_equal(three.snapshot().scan, one.snapshot().scan)
        first, second = one.step(0.2, 0.3), three.step(0.2, 0.3)
        assert first.reward == second.reward
        assert bits(one)[2 * beams :] == bits(three)[6 * beams :]
        seen.append(one.observation.scan.copy())
    three.reset()
    assert len(np.unique(three.observation.scan.reshape(3, beams), axis=0)) == 1


@pytest.mark.parametrize("moment", ["report", "present"])
def test_a_delayed_estimate_is_heard_steps_later_and_nothing_else_changes(moment: str) -> None:
    commands = [(0.4, 0.3), (0.2, -0.9), (0.0, 0.0), (0.2, 0.9), (0.4, 0.0), (0.6, -0.3)]
    prompt = started(episode=2)
    task = LATE.task.model_copy(update={"judged_moment": moment})
    late = started(LATE.model_copy(update={"task": task}), episode=2)
    said = [(prompt.localization.pose_estimated.copy(), prompt.localization.variance.copy())]
    truths = [prompt.world.pose_true.copy()]
    for step, (v, w) in enumerate(commands, 1):
        prompt.step(v, w)
        truths.append(prompt.world.pose_true.copy())
        transition = late.step(v, w)
        belief = prompt.localization
        said.append((belief.pose_estimated.copy(), belief.variance.copy()))
        np.testing.assert_array_equal(late.localization.pose_estimated, said[step][0])
        pose, variance = said[max(0, step - 2)]
        seen = np.zeros(6, np.float32)
        goal_vector(pose, variance, late.world.goal, late.world.start_pose[2], 10.0, seen)
        np.testing.assert_array_equal(late.observation.goal, seen)
        np.testing.assert_array_equal(late.track.path_estimated[step], pose[:2])
        before = said[max(0, step - 3)][0]
        age = 2 if moment == "report" else 0  # whether the truth is as old as what is heard
        judged, judged_before = truths[max(0, step - age)], truths[max(0, step - 1 - age)]
        grown = pose_error(judged, pose) - pose_error(judged_before, before)
        assert transition.parts[1] == pytest.approx(-400.0 * grown, abs=1e-9)


def test_turning_costs_nothing_because_it_is_heard_late() -> None:
    """Paid for the present truth, whoever turns loses 144 a step: such a policy learns to stand."""
    paid = {}
    for moment in ("report", "present"):
        exact = {"initial_deviation_xy": 0.0, "initial_deviation_yaw": 0.0, "delay": 1}
        config = made_config(
            localization=exact,
            world={"odometry_deviation": 0.0},
            task={"judged_moment": moment, "lost_angle": 0.3},
        )
        navigation = started(config)
        navigation.world.people.count[0] = 0
        transition = navigation.step(0.0, 0.9)
        paid[moment] = transition.parts[1]
        assert (navigation.outcome == "lost") == (moment == "present")
    assert paid["present"] == pytest.approx(-400.0 * 0.36, abs=4.0)
    assert abs(paid["report"]) < 4.0


@pytest.mark.parametrize("ticks", [[2, 4], [1, 4], [1, 2, 4], [4]])
def test_the_filter_hears_the_ticks_that_it_is_told_to(ticks: list[int]) -> None:
    """The slow twin of the few: the filter is called after those ticks alone."""
    config = made_config(localization={"update_ticks": ticks})
    navigation = started(config, episode=2)
    place, field = SURROUNDINGS
    world = World(place, config.world)
    filter_ = localization.AMCL(field, config.localization, config.world.laser)
    bearings = beam_bearings(config.world.laser)[::12].astype(np.float32)
    states = episode_states(config.seed, 0, 2)
    world.reset(config.seed, 0, 2)
    filter_.reset(world.start_pose, states[Stream.LOCALIZATION])
    filter_.update(world.pose_odometry, world.scan()[::12], bearings)
    for v, w in [(0.4, 0.3), (0.2, -0.9), (0.2, 0.9), (0.4, 0.0)]:
        navigation.step(v, w)
        world.begin_step(v, w)
        for tick in range(1, 5):
            world.tick()
            if tick == 4:
                filter_.update(world.pose_odometry, world.scan()[::12], bearings)
            elif tick in ticks:
                filter_.update(world.pose_odometry, world.scan_sparse(12), bearings)
        np.testing.assert_array_equal(navigation.world.pose_true, world.pose_true)
        np.testing.assert_array_equal(navigation.localization.particles, filter_.particles)
        np.testing.assert_array_equal(navigation.localization.covariance, filter_.covariance)


def test_the_truth_is_late_where_it_is_said_to_be() -> None:
    navigation = started(made_config(localization={"kind": "perfect", "delay": 3}))
    navigation.step(0.6, 0.9)
    assert navigation.track.path_estimated[1] == pytest.approx(navigation.world.pose_true[:2])
    navigation = started(
        made_config(localization={"preset": "perfect", "delay": 3, "late_truth": True})
    )
    truths = [navigation.world.pose_true.copy()]
    for _ in range(5):
        navigation.step(0.6, 0.9)
        truths.append(navigation.world.pose_true.copy())
    assert np.hypot(*(truths[2] - truths[5])[:2]) > 0.05
    np.testing.assert_array_equal(navigation.pose_heard, truths[2])


def test_nobody_arrives_without_moving() -> None:
    here = {"start": [1.5, 1.5, 3.5, 3.5], "goal": [1.5, 2.5, 3.5, 4.5]}  # they overlap
    scenario = {**SCENARIO, "robot": [here], "pedestrians": {"count": [0, 0]}}
    for arrive in (0.5, 0.8):
        config = made_config(scenario=scenario, task={"arrive_distance": arrive})
        place, field = build_surroundings(config)
        assert place.arrive_distance == arrive
        navigation = Navigation(place, field, config, 0)
        for episode in range(100):
            navigation.reset(episode)
            assert not navigation.step(0.0, 0.0).terminated, episode
