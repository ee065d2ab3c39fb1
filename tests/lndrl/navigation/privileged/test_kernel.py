"""The privileged floats are what a plain reading of the worlds says, whenever it is read."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest

from lndrl.config import RunConfig, load_scenario
from lndrl.localization import AMCL
from lndrl.navigation import Navigation, Observation, VectorNavigation, build_surroundings
from lndrl.navigation.batch import NavigationBatch
from lndrl.navigation.privileged.floats import LIMIT, NAMES
from lndrl.navigation.privileged.kernel import know_worlds, squash

SMALL: dict[str, Any] = {
    "scenario": {
        "name": "small",
        "size": [12.0, 8.0],
        "pedestrians": {
            "count": [3, 5],
            "routes": [{"start": [3, 5, 5, 7], "goal": [9, 5, 11, 7]}],
        },
        "robot": [{"start": [1, 1, 2, 2], "goal": [9, 1, 10, 2]}],
    },
    "localization": {"min_particles": 50, "max_particles": 100, "delay": 2},
    "task": {"time_limit": 2.4, "map_extent": 5.0},
    "world": {"odometry_deviation": 0.3},
}
CONFIGS = {
    "small": RunConfig.model_validate(SMALL),
    "present": RunConfig.model_validate(
        {**SMALL, "task": {**SMALL["task"], "judged_moment": "present"}}
    ),
    "perfect": RunConfig.model_validate({**SMALL, "localization": "perfect"}),
    "random": RunConfig.model_validate(
        {**SMALL, "scenario": load_scenario("random").model_dump(), "task": {"time_limit": 2.0}}
    ),
}
WORLDS = 3


def wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def in_frame(pose: np.ndarray, offset: np.ndarray) -> np.ndarray:
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    turned: np.ndarray = np.array([[cosine, sine], [-sine, cosine]]) @ offset
    return turned


def logarithmic(value: float, unit: float) -> float:
    return math.copysign(math.log(1.0 + abs(value) / unit), value)


def clusters(poses: np.ndarray, weights: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Shares of the weight and mean places, heaviest first: bins of 0.5 m and 10 degrees."""
    members: dict[tuple[int, int, int], list[int]] = {}
    for i, (x, y, yaw) in enumerate(poses):
        turn = min(int((yaw + math.pi) // math.radians(10.0)), 35)
        members.setdefault((math.floor(x / 0.5), math.floor(y / 0.5), turn), []).append(i)
    found, left = [], set(members)
    while left:
        stack, cluster = [left.pop()], []
        while stack:
            here = stack.pop()
            cluster += members[here]
            near = {
                (here[0] + dx, here[1] + dy, (here[2] + da) % 36)
                for dx in (-1, 0, 1) for dy in (-1, 0, 1) for da in (-1, 0, 1)
            } & left  # fmt: skip
            left -= near
            stack += near
        w = weights[cluster]
        mean = w @ poses[cluster, :2] / w.sum()
        found.append((round(w.sum() / weights.sum(), 12), min(cluster), mean))
    # Of equal ones the first particle's comes first.
    return [(share, mean) for share, _, mean in sorted(found, key=lambda each: (-each[0], each[1]))]


def twin_of_the_filter(world: Navigation) -> list[float]:
    localization = world.localization
    if not isinstance(localization, AMCL):
        return [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    count, room = localization.count, world.batch.localization.max_particles
    slow, fast = localization.averages
    known = slow > 0 and fast > 0
    heaviest, *rest = clusters(
        localization.particles, world.batch.beliefs.weights[world.index, :count]
    )
    second = rest[0] if rest else (0.0, None)
    pose = world.world.pose_true
    return [
        math.log(localization.effective_count) / math.log(room),
        math.log(count) / math.log(room),
        math.log(fast / slow) if known else 0.0,
        float(not known),
        logarithmic(1.0 - heaviest[0], 0.01),
        logarithmic(second[0], 0.01),
        0.0 if second[1] is None else logarithmic(math.dist(second[1], heaviest[1]), 0.1),
        0.0 if second[1] is None else logarithmic(math.dist(second[1], pose[:2]), 0.1),
    ]


def twin(world: Navigation) -> np.ndarray:
    """The floats of one world, read from what everybody may read."""
    simulated = world.world
    pose, estimate = simulated.pose_true, world.localization.pose_estimated
    error = in_frame(pose, estimate[:2] - pose[:2])
    heard, judged = world.pose_heard, world.pose_judged
    goal = in_frame(pose, simulated.goal - pose[:2])
    half = world.config.task.map_extent / 2
    unseen = []
    for place, velocity in zip(
        simulated.pedestrian_position, simulated.pedestrian_velocity, strict=True
    ):
        offset = place - pose[:2]
        if np.abs(in_frame(pose, offset)).max() > half:
            distance = math.hypot(*offset)
            unseen.append((distance, -(offset @ velocity) / distance))
    nearest = min(unseen, default=(math.inf, 0.0))
    values = [
        logarithmic(error[0], 0.1),
        logarithmic(error[1], 0.1),
        logarithmic(wrapped(estimate[2] - pose[2]), 0.1),
        logarithmic(math.dist(heard[:2], judged[:2]), 0.1),
        logarithmic(abs(wrapped(heard[2] - judged[2])), 0.1),
        *twin_of_the_filter(world),
        logarithmic(goal[0], 1.0),
        logarithmic(goal[1], 1.0),
        math.log(1 + len(unseen)),
        half / nearest[0],
        nearest[1],
    ]
    return np.clip(values, -LIMIT, LIMIT).astype(np.float32)


def check(row: np.ndarray, world: Navigation) -> None:
    for name, got, expected in zip(NAMES, row, twin(world), strict=True):
        assert got == pytest.approx(expected, abs=2e-5), name


@pytest.mark.parametrize("kind", CONFIGS)
def test_match_their_twin_from_the_first_observation_to_the_final_one(kind: str) -> None:
    many = VectorNavigation(CONFIGS[kind], worlds=WORLDS, privileged=True)
    rng = np.random.default_rng(0)
    finals: dict[int, np.ndarray] = {}
    many.on_end = lambda world, record: finals.update({world.world_id: twin(world)})
    assert many.privileged is not None
    seen, cut = [], 0
    for _ in range(40):
        for row, world in zip(many.privileged, many.worlds, strict=True):
            check(row, world)
        seen.append(many.privileged.copy())
        finals.clear()
        result = many.step(rng.integers(0, 28, WORLDS))
        assert result.final_privileged is not None
        for i in np.flatnonzero(result.truncated).tolist():
            np.testing.assert_allclose(result.final_privileged[i], finals[i], atol=2e-5)
            assert not np.array_equal(result.final_privileged[i], many.privileged[i])
        cut += int(result.truncated.sum())
    assert cut >= WORLDS
    values = np.concatenate(seen)
    varied = dict(zip(NAMES, values.std(axis=0) > 0, strict=True))
    still = {"perfect": set(NAMES[:13]), "random": {"cleared"}}.get(kind, set())
    assert {name for name in NAMES if not varied[name]} == still


def test_worlds_go_on_as_if_nobody_had_looked() -> None:
    for kind in ("small", "random"):
        looked = VectorNavigation(CONFIGS[kind], worlds=WORLDS, privileged=True)
        alone = VectorNavigation(CONFIGS[kind], worlds=WORLDS)
        assert alone.privileged is None
        rng = np.random.default_rng(1)
        for _ in range(30):
            actions = rng.integers(0, 28, WORLDS)
            mine, theirs = looked.step(actions), alone.step(actions)
            assert theirs.final_privileged is None
            assert mine.reward.tobytes() == theirs.reward.tobytes()
            for name, array in vars(looked.observation).items():
                assert array.tobytes() == getattr(alone.observation, name).tobytes()


@pytest.mark.parametrize("kind", ["small", "random"])
def test_copies_write_to_memory_of_their_own(kind: str) -> None:
    many = VectorNavigation(CONFIGS[kind], worlds=WORLDS, privileged=True)
    rng = np.random.default_rng(2)
    for made in (copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))):
        copied = made(many)
        for _ in range(8):
            actions = rng.integers(0, 28, WORLDS)
            many.step(actions)
            copied.step(actions)
            assert copied.privileged is not None and many.privileged is not None
            assert copied.privileged.tobytes() == many.privileged.tobytes()
            assert not np.shares_memory(copied.privileged, many.privileged)


def test_a_false_cluster_that_has_won_and_the_true_one_behind_it() -> None:
    """The chain by which one gets lost: the second cluster is where the robot is."""
    world = one_world()
    belief, pose = world.batch.beliefs, world.world.pose_true
    count = 100
    world.localization.pose_estimated[:] = (10.0, 6.0, 0.5)
    belief.numbers[0, 0] = count
    rows = belief.particles[0, belief.numbers[0, 1]]
    rows[0, :count], rows[1, :count], rows[2, :count] = 10.0, 6.0, 0.5
    rows[0, 60:count], rows[1, 60:count], rows[2, 60:count] = pose
    belief.weights[0, :count] = 0.01
    belief.averages[0] = 2.0, 1.0
    row = dict(zip(NAMES, looked_at(world).tolist(), strict=True))
    apart = math.hypot(10.0 - pose[0], 6.0 - pose[1])
    assert row["second_mass"] == pytest.approx(math.log(41.0), abs=1e-5)
    assert row["elsewhere"] == pytest.approx(math.log(41.0), abs=1e-5)
    assert row["second_error"] == pytest.approx(0.0, abs=1e-5)
    assert row["second_distance"] == pytest.approx(math.log(1 + apart / 0.1), abs=1e-5)
    assert math.hypot(*(10 * np.expm1(np.abs([row["error_x"], row["error_y"]])))) == pytest.approx(
        100 * apart, rel=1e-4
    )
    assert (row["ratio"], row["cleared"]) == (pytest.approx(-math.log(2.0), abs=1e-6), 0.0)
    belief.averages[0] = 0.0  # after a burst
    row = dict(zip(NAMES, looked_at(world).tolist(), strict=True))
    assert (row["ratio"], row["cleared"]) == (0.0, 1.0)


def one_world() -> Navigation:
    config = CONFIGS["small"]
    world = Navigation(*build_surroundings(config), config, 0)
    world.reset(0)
    return world


def looked_at(world: Navigation) -> np.ndarray:
    out = np.full((1, len(NAMES)), np.nan, np.float32)
    world.batch.know(out)
    return out[0]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e30])
@pytest.mark.parametrize("spoilt", ["pose", "goal", "report", "people", "particles", "averages"])
def test_never_beyond_the_limit(spoilt: str, value: float) -> None:
    world = one_world()
    batch = world.batch
    {
        "pose": batch.world.robots.pose,
        "goal": batch.world.robots.goal,
        "report": batch.tracks.reports,
        "people": batch.world.people.position,
        "particles": batch.beliefs.particles,
        "averages": batch.beliefs.averages,
    }[spoilt][...] = value
    assert (np.abs(looked_at(world)) <= LIMIT).all()


@pytest.mark.parametrize("number", [10**9, -(10**9), 0])
@pytest.mark.parametrize("place", ["count", "current", "people", "used"])
def test_never_outside_of_the_arrays(place: str, number: int) -> None:
    world = one_world()
    batch = world.batch
    spoilt: dict[str, np.ndarray] = {
        "count": batch.beliefs.numbers[:, 0],
        "current": batch.beliefs.numbers[:, 1],
        "people": batch.world.people.count,
        "used": batch.shared.bins.used,
    }
    spoilt[place][...] = number
    fence = np.full((3, len(NAMES)), 7.0, np.float32)
    know_worlds(batch._packed, 0, fence[1:2])
    assert (fence[[0, 2]] == 7.0).all() and (np.abs(fence) <= LIMIT).all()


def test_worlds_and_arrays_that_are_not_there() -> None:
    config = CONFIGS["small"]
    shown = Observation.zeros_for(2, config)
    batch = NavigationBatch(*build_surroundings(config), config, 2, shown)
    for out, first in ((3, 0), (1, 2), (1, -1)):
        with pytest.raises(ValueError, match="are not among 2"):
            batch.know(np.zeros((out, len(NAMES)), np.float32), first)
    wrong: Any
    for wrong in (np.zeros((2, 3), np.float32), np.zeros((2, len(NAMES))), np.zeros(2, np.float32)):
        with pytest.raises(ValueError, match=r"need a float32 \(n, 18\)"):
            batch.know(wrong)
    narrow, far = np.full((2, 3), 7.0, np.float32), np.full((2, len(NAMES)), 7.0, np.float32)
    know_worlds(batch._packed, 0, narrow)
    know_worlds(batch._packed, 2, far)
    know_worlds(batch._packed, -2, far)
    assert (narrow == 7.0).all() and (far == 7.0).all()


def test_squashed_values_keep_sign_and_size() -> None:
    assert squash(0.0, 0.1) == 0.0
    assert squash(-0.1, 0.1) == pytest.approx(-math.log(2.0))
    assert squash(0.001, 0.1) == pytest.approx(0.00995, abs=1e-5)
    assert squash(2000.0, 0.1) < LIMIT < squash(2500.0, 0.1)
