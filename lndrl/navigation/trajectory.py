"""The one schema of an upload's arrays: what actors send and learners accept.

T steps of B worlds; people are packed (only valid rows travel). ``final_*`` hold the observation
that follows a step wherever the learner needs its value and no next row has it: after every
truncated step, and after the last step of every world whose episode goes on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig, TaskConfig
from lndrl.navigation.observation import Observation
from lndrl.navigation.privileged.floats import LIMIT, NAMES

_TOLERANCE = 1e-4  # float32 rounding of bounds that were kept in float64
_MAX_COORDINATE = 1e6  # m; far beyond any map, keeps float32 arithmetic finite
_MAX_SPEED = 100.0  # m/s of a person
_MAX_REWARD = 1e9  # its square, summed over a batch, is still a float32
_LEAST_LOG_PROB = -104.0  # a float32 probability beyond is 0, and such an action is not drawn

# name -> (dtype, axes); T steps, B worlds, M and G packed people, F final rows
SCHEMA: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "scan": ("<u2", ("T", "B", "beams")),
    "pedestrian_rows": ("<f4", ("M", 4)),
    "pedestrian_count": ("|u1", ("T", "B")),
    "goal": ("<f4", ("T", "B", 6)),
    "action": ("|u1", ("T", "B")),
    "log_prob": ("<f4", ("T", "B")),
    "reward": ("<f4", ("T", "B")),
    "terminated": ("|u1", ("T", "B")),
    "truncated": ("|u1", ("T", "B")),
    "version": ("<u4", ("T", "B")),
    "final_index": ("<i4", ("F",)),
    "final_scan": ("<u2", ("F", "beams")),
    "final_pedestrian_rows": ("<f4", ("G", 4)),
    "final_pedestrian_count": ("|u1", ("F",)),
    "final_goal": ("<f4", ("F", 6)),
}

TEACHER = "teacher"
MOST_COST = 60_000.0
"""Cost of an action above the teacher's cheapest, at most: nearly the largest float16."""
PRIVILEGED, FINAL_PRIVILEGED = "privileged", "final_privileged"
# L is T where a teacher has labelled the chunk, else 0; A actions.
OPTIONAL: dict[str, tuple[str, tuple[str | int, ...]]] = {
    TEACHER: ("<f2", ("L", "B", "A")),
    PRIVILEGED: ("<f4", ("T", "B", len(NAMES))),
    FINAL_PRIVILEGED: ("<f4", ("F", len(NAMES))),
}
"""Arrays that only some runs have, see ``schema_of``."""

Array = tuple[np.dtype[Any], tuple[str | int, ...]]
"""Type and axes of an array."""


def schema_of(config: RunConfig) -> dict[str, tuple[str, tuple[str | int, ...]]]:
    """The arrays of an upload in a run of ``config``: those of ``SCHEMA``, and some of OPTIONAL."""
    return {name: (dtype.str, axes) for name, (dtype, axes) in _schema_of(config).items()}


def _schema_of(config: RunConfig) -> Mapping[str, Array]:
    return _schema(config.ppo.teacher is not None, config.learner.privileged_critic)


@lru_cache
def _schema(teacher: bool, privileged: bool) -> Mapping[str, Array]:
    wanted = {TEACHER: teacher, PRIVILEGED: privileged, FINAL_PRIVILEGED: privileged}
    named = SCHEMA | {name: OPTIONAL[name] for name in OPTIONAL if wanted[name]}
    return {name: (np.dtype(dtype), axes) for name, (dtype, axes) in named.items()}


_EPISODES = 4
"""Episodes that end in a chunk per world, at most as a rule; records travel in the header."""
_RECORD = 512  # bytes of one, at most
_HEADER = 2**14  # bytes of all else that stands beside the arrays


def most_bytes(config: RunConfig, worlds: int) -> int:
    """Bytes that a chunk of ``worlds`` worlds takes on the wire when people crowd everywhere."""
    steps, people = config.actor.horizon, config.task.max_pedestrians
    finals = worlds * (2 + (steps - 1) // config.steps_limit)
    sizes = {
        "T": steps,
        "B": worlds,
        "beams": config.task.scan_frames * config.world.laser.beams,
        "M": steps * worlds * people,
        "F": finals,
        "G": finals * people,
        "L": steps,
        "A": _actions(config.task),
    }
    arrays = sum(
        np.dtype(dtype).itemsize
        * math.prod(axis if isinstance(axis, int) else sizes[axis] for axis in axes)
        for dtype, axes in schema_of(config).values()
    )
    return arrays + worlds * _EPISODES * _RECORD + _HEADER


def above_cheapest(costs: NDArray[np.float64]) -> NDArray[np.float16]:
    """A teacher's ``costs`` (B, A) as labels: above the cheapest, at most MOST_COST.

    All 0 where no action has a finite cost, which then teaches no preference.
    """
    cheapest = costs.min(axis=1, keepdims=True)
    known = np.isfinite(cheapest)
    above = np.where(known, costs - np.where(known, cheapest, 0.0), 0.0)
    return np.minimum(above, MOST_COST).astype(np.float16)


def final_indices(
    terminated: NDArray[np.bool_] | NDArray[np.uint8],
    truncated: NDArray[np.bool_] | NDArray[np.uint8],
) -> NDArray[np.int32]:
    """Flat indices t * B + b, ascending, of the steps (T, B) whose next observation is stored."""
    needed = np.asarray(truncated) != 0
    needed[-1] |= np.asarray(terminated)[-1] == 0
    return np.flatnonzero(needed).astype(np.int32)


@dataclass
class Trajectory:
    """T steps of B worlds.

    observation (T, B) before each action; action uint8, log_prob, reward float32, terminated and
    truncated uint8 0/1 (never both), version uint32 (weights the action was drawn from), all
    (T, B); final_index int32 (F,) from ``final_indices`` and final_observation (F,).
    teacher float16 (T, B, A): what the run's teacher says that each action costs above its
    cheapest, at most MOST_COST; (0, B, A) where it was not asked, None in a run without one.
    privileged float32 (T, B, K), final_privileged (F, K): what only the critic sees of the states
    observed (``lndrl.navigation.privileged``), None in a run without learner.privileged_critic.
    """

    observation: Observation
    action: NDArray[np.uint8]
    log_prob: NDArray[np.float32]
    reward: NDArray[np.float32]
    terminated: NDArray[np.uint8]
    truncated: NDArray[np.uint8]
    version: NDArray[np.uint32]
    final_index: NDArray[np.int32]
    final_observation: Observation
    teacher: NDArray[np.float16] | None = None
    privileged: NDArray[np.float32] | None = None
    final_privileged: NDArray[np.float32] | None = None

    @property
    def steps(self) -> int:
        """T."""
        return self.action.shape[0]

    @property
    def worlds(self) -> int:
        """B."""
        return self.action.shape[1]

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of ``SCHEMA``, people packed; contiguous, little-endian."""
        final = self.final_observation
        arrays = {
            "scan": self.observation.scan,
            "pedestrian_rows": _pack(self.observation),
            "pedestrian_count": self.observation.pedestrian_count,
            "goal": self.observation.goal,
            "action": self.action,
            "log_prob": self.log_prob,
            "reward": self.reward,
            "terminated": self.terminated,
            "truncated": self.truncated,
            "version": self.version,
            "final_index": self.final_index,
            "final_scan": final.scan,
            "final_pedestrian_rows": _pack(final),
            "final_pedestrian_count": final.pedestrian_count,
            "final_goal": final.goal,
        }
        for name in OPTIONAL:
            if getattr(self, name) is not None:
                arrays[name] = getattr(self, name)
        kinds = SCHEMA | OPTIONAL
        return {
            name: np.ascontiguousarray(array, dtype=kinds[name][0])
            for name, array in arrays.items()
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]], config: RunConfig) -> Trajectory:
        """Read and check an upload against ``config``.

        Raises ValueError with one sentence for anything that ``to_arrays`` could not have made:
        names, dtypes, shapes, ranges, NaN. Arrays may be read-only views; they are not copied
        except people, who are unpacked to zero padded rows.
        """
        checked = _checked_shapes(arrays, config)
        _check_ranges(checked, config.task)
        capacity = config.task.max_pedestrians
        prefixes = ("", "final_")
        observation, final = (
            Observation(
                scan=checked[prefix + "scan"],
                pedestrians=_unpack(
                    checked[prefix + "pedestrian_rows"],
                    checked[prefix + "pedestrian_count"],
                    capacity,
                ),
                pedestrian_count=checked[prefix + "pedestrian_count"],
                goal=checked[prefix + "goal"],
            )
            for prefix in prefixes
        )
        optional: dict[str, Any] = {name: checked.get(name) for name in OPTIONAL}
        rest = ("action", "log_prob", "reward", "terminated", "truncated", "version")
        return cls(
            observation=observation,
            final_index=checked["final_index"],
            final_observation=final,
            **{name: checked[name] for name in rest},
            **optional,
        )


def _valid_rows(count: NDArray[np.uint8], capacity: int) -> NDArray[np.bool_]:
    return np.arange(capacity) < count[..., None]


def _pack(observation: Observation) -> NDArray[np.float32]:
    """Valid people rows (M, 4) in the order of the leading axes."""
    people = observation.pedestrians
    return people[_valid_rows(observation.pedestrian_count, people.shape[-2])]


def _unpack(
    rows: NDArray[np.float32], count: NDArray[np.uint8], capacity: int
) -> NDArray[np.float32]:
    people = np.zeros((*count.shape, capacity, 4), np.float32)
    if len(rows):
        people[_valid_rows(count, capacity)] = rows
    return people


def _checked_shapes(
    arrays: Mapping[str, NDArray[Any]], config: RunConfig
) -> dict[str, NDArray[Any]]:
    """Names, types, dtypes and shapes; returns contiguous arrays."""
    schema = _schema_of(config)
    if not isinstance(arrays, Mapping) or arrays.keys() != schema.keys():
        given = sorted(map(str, arrays)) if isinstance(arrays, Mapping) else type(arrays).__name__
        raise ValueError(f"trajectory needs exactly the arrays {sorted(schema)}, not {given}")
    sizes: dict[str | int, int] = {
        "beams": config.task.scan_frames * config.world.laser.beams,
        "A": _actions(config.task),
    }
    checked = {}
    for name, (dtype, axes) in schema.items():
        array = arrays[name]
        if not isinstance(array, np.ndarray) or array.dtype != dtype:
            kind = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
            raise ValueError(f"trajectory array {name} must be {dtype}, not {kind}")
        shape = array.shape
        if len(shape) != len(axes):
            raise ValueError(f"trajectory array {name} must have {len(axes)} axes")
        for axis, length in zip(axes, shape, strict=True):
            expected = axis if type(axis) is int else sizes.setdefault(axis, length)
            if length != expected:
                raise ValueError(
                    f"trajectory array {name} has shape {shape}, {axis} must be {expected}"
                )
        checked[name] = array if array.flags.c_contiguous else np.ascontiguousarray(array)
    if sizes["T"] < 1 or sizes["B"] < 1:
        raise ValueError("trajectory must hold at least one step of one world")
    if sizes.get("L", 0) not in (0, sizes["T"]):
        raise ValueError(
            f"trajectory array {TEACHER} must be of all {sizes['T']} steps or of none, "
            f"not of {sizes['L']}"
        )
    return checked


def _actions(task: TaskConfig) -> int:
    return len(task.linear_velocities) * len(task.angular_velocities)


def _check_ranges(arrays: dict[str, NDArray[Any]], task: TaskConfig) -> None:
    actions = _actions(task)
    if TEACHER in arrays:
        _require(arrays, TEACHER, 0.0, MOST_COST, "finite, from 0 on")
    for name in arrays.keys() & {PRIVILEGED, FINAL_PRIVILEGED}:
        _require(arrays, name, -LIMIT, LIMIT, f"finite, at most {LIMIT:g} either way")
    _require(arrays, "action", 0, actions - 1, f"below {actions}")
    # A probability of 1 may round to a log probability a hair above 0.
    bounds = f"finite, from {_LEAST_LOG_PROB:g} to 0"
    _require(arrays, "log_prob", _LEAST_LOG_PROB, 1e-5, bounds)
    _require(arrays, "reward", -_MAX_REWARD, _MAX_REWARD, "finite, at most 1e9")
    _require(arrays, "terminated", 0, 1, "0 or 1")
    _require(arrays, "truncated", 0, 1, "0 or 1")
    if (arrays["terminated"] & arrays["truncated"]).any():
        raise ValueError("trajectory step cannot be both terminated and truncated")
    expected = final_indices(arrays["terminated"], arrays["truncated"])
    if not np.array_equal(arrays["final_index"], expected):
        raise ValueError(
            "trajectory final_index must list, ascending, every truncated step and the last "
            "step of every world that goes on"
        )
    for prefix in ("", "final_"):
        _check_people(arrays, task, prefix)
        _check_goal(arrays[prefix + "goal"], task, prefix)


def _check_people(arrays: dict[str, NDArray[Any]], task: TaskConfig, prefix: str) -> None:
    limit = task.max_pedestrians
    _require(arrays, prefix + "pedestrian_count", 0, limit, f"at most {limit}")
    rows = arrays[prefix + "pedestrian_rows"]
    if int(arrays[prefix + "pedestrian_count"].sum(dtype=np.int64)) != len(rows):
        raise ValueError(f"trajectory {prefix}pedestrian_rows must match the counts' sum")
    half = 0.5 * task.map_extent + _TOLERANCE
    x, y, vx, vy = _bounds(np.abs(rows))[1] if len(rows) else [0.0] * 4
    if not (x <= half and y <= half and vx <= _MAX_SPEED and vy <= _MAX_SPEED):
        raise ValueError(f"trajectory {prefix}pedestrian_rows must be people in view, finite")


def _check_goal(goal: NDArray[np.float32], task: TaskConfig, prefix: str) -> None:
    if not goal.size:
        return
    least, most = _bounds(goal.reshape(-1, goal.shape[-1]))
    furthest = _MAX_COORDINATE
    if not all(a >= -furthest and b <= furthest for a, b in _pairs(least, most, 0, 2)):
        raise ValueError(f"trajectory {prefix}goal must hold finite positions")
    turn = math.pi + _TOLERANCE
    if not (least[2] >= -turn and most[2] <= turn):
        raise ValueError(f"trajectory {prefix}goal must hold angles in [-pi, pi]")
    limit = task.variance_limit * (1.0 + 1e-6)
    if not all(a >= 0.0 and b <= limit for a, b in _pairs(least, most, 3, 6)):
        raise ValueError(f"trajectory {prefix}goal must hold variances in [0, {limit:g}]")


# Most uploads are small, and what a check takes is what its calls of NumPy take: so each array is
# looked at twice, for its least and for its largest number. Both are NaN where one of them is, and
# NaN fails every comparison.


def _bounds(rows: NDArray[np.float32]) -> tuple[list[float], list[float]]:
    """The least and the largest of every column of (N, K), N at least 1."""
    return np.minimum.reduce(rows, axis=0).tolist(), np.maximum.reduce(rows, axis=0).tolist()


def _pairs(least: list[float], most: list[float], first: int, end: int) -> zip[tuple[float, float]]:
    return zip(least[first:end], most[first:end], strict=True)


def _require(
    arrays: dict[str, NDArray[Any]], name: str, least: float, most: float, what: str
) -> None:
    """Raise ValueError unless all numbers of an array are from ``least`` to ``most``."""
    array = arrays[name]
    if not array.size:
        return
    flat = array.reshape(-1)
    # Unsigned numbers are never below 0.
    above = array.dtype.kind == "u" or np.minimum.reduce(flat) >= least
    if not (above and np.maximum.reduce(flat) <= most):
        raise ValueError(f"trajectory array {name} must be {what}")
