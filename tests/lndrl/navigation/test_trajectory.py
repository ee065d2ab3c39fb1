"""The upload schema: round trip, and refusal of everything else with ValueError only."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import RunConfig, TaskConfig, WorldConfig
from lndrl.navigation.observation import Observation
from lndrl.navigation.privileged.floats import LIMIT, NAMES
from lndrl.navigation.trajectory import (
    SCHEMA,
    Trajectory,
    final_indices,
    most_bytes,
    schema_of,
)

BEAMS, PEOPLE = 12, 4
CONFIG = RunConfig.model_validate(
    {
        "scenario": {
            "name": "tiny",
            "size": [10, 10],
            "pedestrians": {"count": [0, 0]},
            "robot": [{"start": [1, 1, 2, 2], "goal": [8, 8, 9, 9]}],
        },
        "world": {"laser": {"beams": BEAMS}},
        "task": {"max_pedestrians": PEOPLE},
    }
)
assert isinstance(CONFIG.task, TaskConfig) and isinstance(CONFIG.world, WorldConfig)


def random_observation(rng: np.random.Generator, shape: tuple[int, ...]) -> Observation:
    made = Observation.zeros_for(shape, CONFIG)
    made.scan[...] = rng.integers(0, 65536, made.scan.shape)
    made.pedestrian_count[...] = rng.integers(0, PEOPLE + 1, shape)
    valid = np.arange(PEOPLE) < made.pedestrian_count[..., None]
    made.pedestrians[valid] = rng.uniform(-3, 3, (int(valid.sum()), 4))
    made.goal[...] = rng.uniform(0, 3, made.goal.shape)
    return made


def random_trajectory(seed: int, steps: int, worlds: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    shape = (steps, worlds)
    terminated = rng.random(shape) < 0.2
    truncated = (rng.random(shape) < 0.2) & ~terminated
    index = final_indices(terminated, truncated)
    return Trajectory(
        observation=random_observation(rng, shape),
        action=rng.integers(0, 28, shape).astype(np.uint8),
        log_prob=-rng.random(shape).astype(np.float32),
        reward=rng.normal(size=shape).astype(np.float32),
        terminated=terminated.astype(np.uint8),
        truncated=truncated.astype(np.uint8),
        version=rng.integers(0, 2**32, shape).astype(np.uint32),
        final_index=index,
        final_observation=random_observation(rng, (len(index),)),
    )


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), steps=st.integers(1, 6), worlds=st.integers(1, 4))
def test_round_trip(seed: int, steps: int, worlds: int) -> None:
    sent = random_trajectory(seed, steps, worlds)
    arrays = sent.to_arrays()
    assert {name: array.dtype.str for name, array in arrays.items()} == {
        name: dtype for name, (dtype, _) in SCHEMA.items()
    }
    assert arrays["pedestrian_rows"].shape == (sent.observation.pedestrian_count.sum(), 4)
    for array in arrays.values():
        array.flags.writeable = False
    got = Trajectory.from_arrays(arrays, CONFIG)
    assert (got.steps, got.worlds) == (steps, worlds)
    for name in ("action", "log_prob", "reward", "terminated", "truncated", "version"):
        np.testing.assert_array_equal(getattr(got, name), getattr(sent, name))
    np.testing.assert_array_equal(got.final_index, sent.final_index)
    for a, b in (
        (got.observation, sent.observation),
        (got.final_observation, sent.final_observation),
    ):
        for x, y in zip(vars(a).values(), vars(b).values(), strict=True):
            np.testing.assert_array_equal(x, y)


def test_final_indices() -> None:
    terminated = np.array([[1, 0, 0], [0, 0, 1]], np.uint8)
    truncated = np.array([[0, 1, 0], [1, 0, 0]], np.uint8)
    assert final_indices(terminated, truncated).tolist() == [1, 3, 4]
    assert truncated.tolist() == [[0, 1, 0], [1, 0, 0]]  # left as it was
    assert final_indices(np.ones((1, 2), bool), np.zeros((1, 2), bool)).tolist() == []


def put(array: np.ndarray, value: float) -> np.ndarray:
    changed = array.copy()
    changed.reshape(-1)[0] = value
    return changed


# name of the array, what happens to it, word of the complaint
BAD = [
    ("action", lambda a: put(a, 28), "below 28"),
    ("log_prob", lambda a: put(a, np.nan), "log_prob"),
    ("log_prob", lambda a: put(a, 0.5), "log_prob"),
    ("log_prob", lambda a: put(a, -np.inf), "log_prob"),
    ("reward", lambda a: put(a, np.inf), "reward"),
    ("reward", lambda a: put(a, np.nan), "reward"),
    ("terminated", lambda a: put(a, 2), "0 or 1"),
    ("truncated", lambda a: put(a, 255), "0 or 1"),
    ("truncated", lambda a: 1 - a, "both|final_index"),
    ("final_index", lambda a: a + 1, "final_index"),
    ("final_index", lambda a: a[::-1].copy(), "final_index"),
    ("goal", lambda a: put(a, np.nan), "goal"),
    ("goal", lambda a: a * 4 + 11, "goal"),
    ("goal", lambda a: -a - 0.1, "variances"),
    ("final_goal", lambda a: put(a, np.inf), "final_goal"),
    ("pedestrian_rows", lambda a: put(a, np.nan), "people in view"),
    ("pedestrian_rows", lambda a: put(a, 3.1), "people in view"),
    ("pedestrian_rows", lambda a: a[:-1].copy(), "sum"),
    ("final_pedestrian_rows", lambda a: put(a, -4.0), "people in view"),
    ("pedestrian_count", lambda a: put(a, PEOPLE + 1), "at most"),
    ("pedestrian_count", lambda a: a.astype(np.int64), "uint8"),
    ("scan", lambda a: a.astype(">u2"), "uint16"),
    ("scan", lambda a: a[..., :-1], "beams"),
    ("scan", lambda a: a[:-1], "must be"),
    ("scan", lambda a: a.reshape(-1), "axes"),
    ("version", lambda a: a.tolist(), "list"),
    ("final_scan", lambda a: a[:-1], "F must be"),
    ("reward", lambda a: a.astype(object), "object"),
]


@pytest.mark.parametrize("name, change, complaint", BAD)
def test_refuses(name, change, complaint) -> None:
    arrays = random_trajectory(5, 6, 4).to_arrays()
    arrays[name] = change(arrays[name])
    with pytest.raises(ValueError, match=complaint):
        Trajectory.from_arrays(arrays, CONFIG)


def test_refuses_wrong_names_and_emptiness() -> None:
    arrays = random_trajectory(5, 3, 2).to_arrays()
    for wrong in ({**arrays, "extra": np.zeros(3)}, dict(list(arrays.items())[1:]), None, [1]):
        with pytest.raises(ValueError, match="exactly the arrays"):
            Trajectory.from_arrays(wrong, CONFIG)  # type: ignore[arg-type]
    empty = {
        name: np.zeros(
            [BEAMS if a == "beams" else 0 if isinstance(a, str) else a for a in axes],
            dtype,
        )
        for name, (dtype, axes) in SCHEMA.items()
    }
    with pytest.raises(ValueError, match="at least one step"):
        Trajectory.from_arrays(empty, CONFIG)


@settings(max_examples=120, deadline=None)
@given(data=st.data())
def test_random_corruption_raises_nothing_but_value_error(data: st.DataObject) -> None:
    arrays = random_trajectory(data.draw(st.integers(0, 20)), 4, 3).to_arrays()
    name = data.draw(st.sampled_from(sorted(SCHEMA)))
    array = arrays[name]
    kind = data.draw(st.sampled_from(["bytes", "dtype", "shape", "type", "value"]))
    if kind == "bytes" and array.size:
        raw = bytearray(array.tobytes())
        at = data.draw(st.integers(0, len(raw) - 1))
        raw[at] = data.draw(st.integers(0, 255))
        arrays[name] = np.frombuffer(bytes(raw), array.dtype).reshape(array.shape)
    elif kind == "dtype":
        new = data.draw(st.sampled_from(["<i8", ">f4", "<f8", "|b1", "|S3", "<c8", "|O", "<M8[s]"]))
        arrays[name] = np.zeros(array.shape, new)
    elif kind == "shape":
        shape = data.draw(st.lists(st.integers(0, 5), max_size=4))
        arrays[name] = np.zeros(shape, array.dtype)
    elif kind == "type":
        arrays[name] = data.draw(st.sampled_from([None, 3, "x", [1, 2], {}]))
    elif array.size:
        values = [0, 1, 200] if array.dtype.kind == "u" else [np.nan, np.inf, -np.inf, 1e30, -1e30]
        if array.dtype.kind == "i":
            values = [-1, 2**31 - 1]
        arrays[name] = put(array, data.draw(st.sampled_from(values)))
    try:
        got = Trajectory.from_arrays(arrays, CONFIG)
    except ValueError as error:
        assert len(str(error)) > 10
    else:
        for float_array in (got.log_prob, got.reward, got.observation.goal):
            assert np.isfinite(float_array).all()
        assert got.action.max() < 28
        assert (got.observation.pedestrian_count <= PEOPLE).all()


def test_several_scans_are_part_of_the_schema() -> None:
    network = CONFIG.network.model_copy(update={"scan_encoder": "fan"})
    task = CONFIG.task.model_copy(update={"scan_frames": 3})
    three = CONFIG.model_copy(update={"task": task, "network": network})
    arrays = random_trajectory(0, 4, 2).to_arrays()
    with pytest.raises(ValueError, match=f"beams must be {3 * BEAMS}"):
        Trajectory.from_arrays(arrays, three)
    for name in ("scan", "final_scan"):
        arrays[name] = np.concatenate([arrays[name]] * 3, axis=-1)
    assert Trajectory.from_arrays(arrays, three).observation.scan.shape == (4, 2, 3 * BEAMS)


TAUGHT = CONFIG.model_copy(update={"ppo": CONFIG.ppo.model_copy(update={"teacher": "predictive"})})


def labelled(labels: int, **changes: np.ndarray) -> dict[str, np.ndarray]:
    """Arrays of 3 steps of 2 worlds with so many labelled steps."""
    costs = np.random.default_rng(1).uniform(0, 9, (labels, 2, 28)).astype(np.float16)
    made = random_trajectory(1, 3, 2)
    made.version[:] = 0
    made.teacher = costs
    return {**made.to_arrays(), **changes}


@pytest.mark.parametrize("labels", [0, 3])
def test_labels_of_a_teacher_travel(labels: int) -> None:
    arrays = labelled(labels)
    read = Trajectory.from_arrays(arrays, TAUGHT)
    assert read.teacher is not None and read.teacher.dtype == np.float16
    np.testing.assert_array_equal(read.teacher, arrays["teacher"])


@pytest.mark.parametrize(
    ("costs", "what"),
    [
        (np.zeros((2, 2, 28), np.float16), "of all 3 steps or of none, not of 2"),
        (np.zeros((3, 1, 28), np.float16), "shape"),
        (np.zeros((3, 2, 27), np.float16), "shape"),
        (np.zeros((3, 2, 28), np.float32), "float16"),
        (np.full((3, 2, 28), -1.0, np.float16), "from 0 on"),
        (np.full((3, 2, 28), np.nan, np.float16), "from 0 on"),
        (np.full((3, 2, 28), np.inf, np.float16), "from 0 on"),
    ],
)
def test_labels_that_no_teacher_made_are_refused(costs: np.ndarray, what: str) -> None:
    with pytest.raises(ValueError, match=what):
        Trajectory.from_arrays(labelled(3, teacher=costs), TAUGHT)


def test_labels_belong_to_runs_with_a_teacher() -> None:
    with pytest.raises(ValueError, match="needs exactly"):
        Trajectory.from_arrays(labelled(3), CONFIG)
    with pytest.raises(ValueError, match="needs exactly"):
        Trajectory.from_arrays(random_trajectory(1, 3, 2).to_arrays(), TAUGHT)


def test_room_for_labels_is_counted() -> None:
    from lndrl.navigation.trajectory import most_bytes

    labels = TAUGHT.actor.horizon * 5 * 28 * 2
    assert most_bytes(TAUGHT, 5) - most_bytes(CONFIG, 5) == labels


KNOWING = CONFIG.model_copy(
    update={"learner": CONFIG.learner.model_copy(update={"privileged_critic": True})}
)


def knowing_arrays() -> dict[str, np.ndarray]:
    """An upload of a run whose critic sees more."""
    rng = np.random.default_rng(8)
    sent = random_trajectory(5, 6, 3)
    sent.privileged = rng.uniform(-LIMIT, LIMIT, (6, 3, len(NAMES))).astype(np.float32)
    finals = (len(sent.final_index), len(NAMES))
    sent.final_privileged = rng.uniform(-LIMIT, LIMIT, finals).astype(np.float32)
    return sent.to_arrays()


def test_privileged_floats_travel_where_the_run_has_them_and_nowhere_else() -> None:
    arrays = knowing_arrays()
    assert set(schema_of(KNOWING)) - set(schema_of(CONFIG)) == {"privileged", "final_privileged"}
    got = Trajectory.from_arrays(arrays, KNOWING)
    np.testing.assert_array_equal(got.privileged, arrays["privileged"])
    np.testing.assert_array_equal(got.final_privileged, arrays["final_privileged"])
    with pytest.raises(ValueError, match="needs exactly the arrays"):
        Trajectory.from_arrays(arrays, CONFIG)
    with pytest.raises(ValueError, match="needs exactly the arrays"):
        Trajectory.from_arrays(random_trajectory(5, 6, 3).to_arrays(), KNOWING)
    assert Trajectory.from_arrays(random_trajectory(5, 6, 3).to_arrays(), CONFIG).privileged is None
    steps = KNOWING.actor.horizon
    assert most_bytes(KNOWING, 2) - most_bytes(CONFIG, 2) >= 4 * len(NAMES) * 2 * (steps + 2)


@pytest.mark.parametrize("name", ["privileged", "final_privileged"])
@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda a: put(a, np.nan), "finite, at most 10 either way"),
        (lambda a: put(a, np.inf), "finite, at most 10 either way"),
        (lambda a: put(a, -10.001), "finite, at most 10 either way"),
        (lambda a: a[..., :-1].copy(), "must be 18"),
        (lambda a: a[1:].copy(), "must be"),
        (lambda a: a.astype(np.float64), "must be float32"),
        (lambda a: a[..., 0].copy(), "axes"),
    ],
)
def test_privileged_floats_are_checked(name: str, spoil: Any, complaint: str) -> None:
    arrays = knowing_arrays()
    arrays[name] = spoil(arrays[name])
    with pytest.raises(ValueError, match=complaint) as raised:
        Trajectory.from_arrays(arrays, KNOWING)
    assert name in str(raised.value)
