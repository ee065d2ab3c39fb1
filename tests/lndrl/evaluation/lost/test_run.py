"""Real episodes, watched: nothing changes, and what is noted is what happened."""

from __future__ import annotations

import multiprocessing

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation import EpisodeRunner, evaluate
from lndrl.evaluation.lost import AHEAD, Limits, Trace, trace_episodes
from lndrl.evaluation.lost.record import people_ahead
from lndrl.evaluation.lost.summary import errors, loss_of
from lndrl.navigation import Navigation
from lndrl.planners import PlannerSource, planner_source
from lndrl.policy import initial_weights

EPISODES = 11


def configuration(**localization: object) -> RunConfig:
    """A small room, and a robot whose wheels slip so much that it is soon lost."""
    scenario = {
        "name": "room",
        "size": [9, 6],
        "obstacles": [{"box": [4, 4, 5, 6]}],
        "pedestrians": {
            "count": [2, 2],
            "routes": [{"start": [4, 1, 5, 2], "goal": [4, 2.5, 5, 3.5]}],
        },
        "robot": [{"start": [1, 1, 2, 5], "goal": [7, 1, 8, 5]}],
    }
    return RunConfig.model_validate(
        {
            "scenario": scenario,
            "world": {"odometry_deviation": 0.5},
            "task": {"time_limit": 20.0},
            "localization": {
                "min_particles": 100, "max_particles": 300, "delay": 1, **localization
            },
        }
    )  # fmt: skip


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return configuration()


@pytest.fixture(scope="module")
def traces(config: RunConfig) -> list[Trace]:
    return trace_episodes(planner_source("random"), [config], EPISODES)


def test_watching_changes_nothing(config: RunConfig, traces: list[Trace]) -> None:
    records = evaluate("random", config, EPISODES, config.seed).records
    assert [t.outcome for t in traces] == [record.outcome for record in records]
    assert [t.steps for t in traces] == [record.steps for record in records]
    assert [t.episode for t in traces] == list(range(EPISODES))
    assert sum(t.is_lost for t in traces) >= 2, "the test needs somebody who gets lost"


def test_the_result_does_not_depend_on_the_number_of_workers(
    config: RunConfig, traces: list[Trace]
) -> None:
    told: list[Trace] = []
    again = trace_episodes(planner_source("random"), [config], EPISODES, 2, progress=told.append)
    assert len(told) == EPISODES and multiprocessing.active_children() == []
    for one, other in zip(traces, again, strict=True):
        assert (one.episode, one.outcome) == (other.episode, other.outcome)
        np.testing.assert_array_equal(one.moments, other.moments)


def test_scenarios_come_in_their_order(config: RunConfig) -> None:
    other = config.model_copy(
        update={"scenario": config.scenario.model_copy(update={"name": "other"})}
    )
    found = trace_episodes(planner_source("straight"), [other, config], 2, workers=2)
    assert [(t.scenario, t.episode) for t in found] == [
        ("other", 0), ("other", 1), ("room", 0), ("room", 1)]  # fmt: skip


def test_a_policy_is_watched_in_the_blocks_that_it_is_evaluated_in() -> None:
    small = {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4}
    config = configuration()
    config = RunConfig.model_validate({**config.model_dump(), "network": small})
    learned = PlannerSource("learned", config, initial_weights(config))
    records = evaluate(learned, config, 3, config.seed).records
    found = trace_episodes(learned, [config], 3)
    assert [(t.outcome, t.steps) for t in found] == [(r.outcome, r.steps) for r in records]


def test_what_is_noted_is_what_happened(config: RunConfig, traces: list[Trace]) -> None:
    seen: dict[int, list[tuple[float, ...]]] = {}

    def watch(world: Navigation) -> None:
        scan = world.scan
        people = world.world.pedestrian_position
        seen.setdefault(world.world_id, []).append(
            (
                *world.world.pose_true,
                *world.batch.beliefs.pose[world.index],
                *world.batch.beliefs.averages[world.index],
                sum(reading < config.world.laser.range_max for reading in scan) / len(scan),
                slow_people_ahead(world.world.pose_true, people),
            )
        )

    list(EpisodeRunner(planner_source("random"), config)(range(4), watch))
    names = ("x", "y", "yaw", "x_estimated", "y_estimated", "yaw_estimated", "slow_average",
             "fast_average", "echoes", "people")  # fmt: skip
    for trace, rows in zip(traces[:4], [seen[k] for k in sorted(seen)], strict=True):
        noted = np.stack([trace.column(name) for name in names], axis=1)
        np.testing.assert_array_equal(noted, np.array(rows))
        first, second = trace.column("first_cluster"), trace.column("second_cluster")
        assert (first >= second).all() and (first + second <= 1 + 1e-12).all()
        assert ((trace.column("particles") >= 100) & (trace.column("particles") <= 300)).all()


def slow_people_ahead(pose: np.ndarray, people: np.ndarray) -> int:
    """One after another, with the angle between."""
    count = 0
    for x, y in people - pose[:2]:
        bearing = (np.arctan2(y, x) - pose[2] + np.pi) % (2 * np.pi) - np.pi
        count += np.hypot(x, y) <= AHEAD and abs(bearing) <= np.pi / 2
    return int(count)


def test_people_ahead_are_near_and_in_view() -> None:
    people = np.array([[6.0, 0.0], [6.1, 0.0], [0.0, 3.0], [-0.1, 3.0], [-2.0, 0.0]])
    assert people_ahead(np.zeros(3), people, np.pi / 2) == 2
    assert people_ahead(np.zeros(3), people, np.pi) == 4
    assert people_ahead(np.array([0.0, 0.0, np.pi]), people, np.pi / 2) == 3
    assert people_ahead(np.zeros(3), np.zeros((0, 2)), np.pi / 2) == 0


def test_a_lost_episode_ends_with_a_report_beyond_a_limit(
    config: RunConfig, traces: list[Trace]
) -> None:
    limits = Limits(config.task.lost_distance, config.task.lost_angle, config.localization.delay)
    for trace in traces:
        position_error, angle_error = errors(trace)
        far = (position_error > limits.distance) | (angle_error > limits.angle)
        if trace.is_lost:
            loss = loss_of(trace, limits)
            assert loss.limit == "delay" or far[loss.moment]
            assert trace.steps - loss.moment <= limits.delay
        # Nobody goes on after a report that was far off has been heard.
        assert not far[: -1 - limits.delay].any()


def test_who_is_told_the_truth_is_refused() -> None:
    with pytest.raises(UserError, match="nobody gets lost who is told the truth"):
        trace_episodes(planner_source("random"), [configuration(kind="perfect", delay=0)], 1)
