"""The privileged floats of many worlds, written by one compiled call.

It reads the truth, so nothing that acts may ever see its result. It changes nothing that a later
step reads: worlds go on bit for bit as if it had not been called.
"""

from __future__ import annotations

import math

import numpy as np

from lndrl.kernels import kernel
from lndrl.localization.angles import wrap
from lndrl.localization.belief import COUNT, CURRENT, EFFECTIVE_COUNT, Belief, belief_row
from lndrl.localization.belief import Scratch as FilterScratch
from lndrl.localization.bins import Bins
from lndrl.localization.clusters import two_places
from lndrl.localization.update import fill_bins, fits
from lndrl.navigation.privileged.floats import GOAL_UNIT, LIMIT, MASS_UNIT, NAMES, POSE_UNIT
from lndrl.navigation.step import Task
from lndrl.navigation.track import Track
from lndrl.world.people import People
from lndrl.world.robot import Robot

_FLOATS = len(NAMES)


@kernel(_nrt=False, error_model="numpy")
def squash(value, unit):
    """``value`` on a scale that is linear below ``unit`` and logarithmic above, sign kept."""
    return math.copysign(math.log1p(abs(value) / unit), value)


@kernel(_nrt=False, error_model="numpy")
def _write_errors(pose_true, pose, report, out):
    """Floats 0 to 4: the filter's ``pose`` (3,), and ``report`` (9,) as in ``Track.reports``."""
    dx, dy = pose[0] - pose_true[0], pose[1] - pose_true[1]
    cosine, sine = math.cos(pose_true[2]), math.sin(pose_true[2])
    out[0] = squash(cosine * dx + sine * dy, POSE_UNIT)
    out[1] = squash(cosine * dy - sine * dx, POSE_UNIT)
    out[2] = squash(wrap(pose[2] - pose_true[2]), POSE_UNIT)
    out[3] = squash(math.hypot(report[0] - report[6], report[1] - report[7]), POSE_UNIT)
    out[4] = squash(abs(wrap(report[2] - report[8])), POSE_UNIT)


@kernel(_nrt=False, error_model="numpy")
def _write_filter(pose_true, belief, scratch, bins, places, out):
    """Floats 5 to 12; ``places`` (2, 3) is room to work in."""
    count, room = belief.numbers[COUNT], math.log(max(belief.weights.size, 2))
    out[5] = math.log(max(belief.quality[EFFECTIVE_COUNT], 1.0)) / room
    out[6] = math.log(max(count, 1)) / room
    slow, fast = belief.averages[0], belief.averages[1]
    known = slow > 0.0 and fast > 0.0
    out[7] = math.log(fast / slow) if known else 0.0
    out[8] = 0.0 if known else 1.0
    if not fits(belief, scratch, bins):
        return
    particles = belief.particles[belief.numbers[CURRENT]]
    k = fill_bins(particles, count, scratch, bins)
    two_places(particles, belief.weights, count, scratch.bin_of, bins, k, places)
    out[9] = squash(max(1.0 - places[0, 0], 0.0), MASS_UNIT)
    out[10] = squash(places[1, 0], MASS_UNIT)
    if places[1, 0] > 0.0:
        x, y = places[1, 1], places[1, 2]
        out[11] = squash(math.hypot(x - places[0, 1], y - places[0, 2]), POSE_UNIT)
        out[12] = squash(math.hypot(x - pose_true[0], y - pose_true[1]), POSE_UNIT)


@kernel(error_model="numpy")
def _write_surroundings(pose, goal, position, velocity, extent, out):
    """Floats 13 to 17; ``position`` and ``velocity`` (P, 2) of everybody, in the map frame."""
    half = 0.5 * extent
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = goal[0] - pose[0], goal[1] - pose[1]
    out[13] = squash(cosine * dx + sine * dy, GOAL_UNIT)
    out[14] = squash(cosine * dy - sine * dx, GOAL_UNIT)
    unseen = 0
    nearest = math.inf
    for i in range(position.shape[0]):
        dx, dy = position[i, 0] - pose[0], position[i, 1] - pose[1]
        # In single precision, as ``pedestrians_in_view`` decides who is seen.
        x = np.float32(cosine * dx + sine * dy)
        y = np.float32(cosine * dy - sine * dx)
        if abs(x) <= half and abs(y) <= half:
            continue
        unseen += 1
        distance = math.hypot(dx, dy)
        if 0.0 < distance < nearest:
            nearest = distance
            out[16] = half / distance
            out[17] = -(dx * velocity[i, 0] + dy * velocity[i, 1]) / distance
    out[15] = math.log1p(unseen)


@kernel(error_model="numpy")
def know_worlds(machine, first, out):
    """Write the floats of the worlds from ``first`` on to ``out`` (n, len(NAMES)), float32.

    ``machine`` is a packed ``Machine`` whose worlds have been observed. What belongs to nobody
    (clusters of a filter without particles, people where nobody is) is 0. Worlds that the machine
    does not have are left out, and so are all where ``out`` is of another width.
    """
    robots, people = Robot(*machine[0]), People(*machine[1])
    beliefs, tracks = Belief(*machine[2]), Track(*machine[3])
    shared, task = machine[7], Task(*machine[8])
    scratch, bins, perfect = FilterScratch(*shared[0]), Bins(*shared[1]), shared[8]
    if out.shape[1] != _FLOATS:
        return
    places = np.zeros((2, 3))
    row = np.zeros(_FLOATS)
    for i in range(max(first, 0), min(first + len(out), len(robots.pose))):
        row[:] = 0.0
        pose, crowd = robots.pose[i], people.count[i, 0]
        _write_errors(pose, beliefs.pose[i], tracks.reports[i, -1], row)
        if perfect:
            row[5] = row[6] = 1.0
        else:
            _write_filter(pose, belief_row(beliefs, i), scratch, bins, places, row)
        _write_surroundings(
            pose, robots.goal[i], people.position[i, :crowd], people.velocity[i, :crowd],
            task.map_extent, row,
        )  # fmt: skip
        for j in range(_FLOATS):
            # NaN, which only a spoilt state gives, becomes a limit, too.
            value = row[j] if row[j] < LIMIT else LIMIT
            out[i - first, j] = value if value > -LIMIT else -LIMIT
