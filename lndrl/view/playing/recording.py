"""An episode for the Rerun viewer: live, or as an ``.rrd`` file. The extra ``rerun``.

Entities follow ROS's frames (REP-105): ``map``, ``map/odom``, ``map/odom/base_link`` and
``map/odom/base_link/scan``, so that the scan lies where the robot believes to be; the truth is
``map/base_link_true``. Time lines are ``step`` (control steps) and ``sim_time`` (simulated s).
"""

from __future__ import annotations

import importlib
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.navigation import WorldSnapshot
from lndrl.view.palette import (
    BELIEF,
    BELIEF_DARK,
    ECHO,
    FLOOR,
    GOAL,
    LEG,
    OUTCOME,
    OUTCOME_WORD,
    PERSON,
    SERIES,
    TRUTH,
    WALL,
)
from lndrl.view.playing.course import Course, course_of, deviation_ellipse

Floats = NDArray[np.float64]
APPLICATION = "lndrl"
VIEWER = "viewer"
"""Where to, for a viewer that is started on this machine."""
SENT_WITHIN = 20.0
"""s that a viewer has to take all of it in."""
_CIRCLE = np.linspace(0.0, 2.0 * math.pi, 49)


def save_recording(snapshots: Sequence[WorldSnapshot], where: str) -> None:
    """Record an episode to ``where``: a file ``*.rrd``, VIEWER, or the address of a viewer.

    Raises UserError where rerun-sdk is missing, an address is none, or nobody listens there;
    OSError where a file cannot be written.
    """
    rr = needed()
    check_target(where)
    stream = rr.RecordingStream(APPLICATION, recording_id=_name(snapshots[-1]))
    if where.endswith(".rrd"):
        with open(where, "ab"):  # the library would tell of a folder that is none in its own words
            pass
        stream.save(Path(where), default_blueprint=_layout())
    else:
        try:
            if where == VIEWER:
                stream.spawn(default_blueprint=_layout())
            else:
                stream.connect_grpc(where, default_blueprint=_layout())
        except Exception as error:
            raise UserError(f"--rerun {where}: {str(error).splitlines()[0]}") from None
    record(snapshots, stream)
    try:
        stream.flush(timeout_sec=SENT_WITHIN)
    except Exception:  # it waits for ever for a viewer that is not there
        raise UserError(f"--rerun {where}: no viewer has taken it in {SENT_WITHIN:g} s") from None
    stream.disconnect()


def check_target(where: str) -> None:
    """Raises UserError unless ``where`` is something that ``save_recording`` can record to."""
    if where == VIEWER or "://" in where:
        return
    if not where.endswith(".rrd"):
        raise UserError(
            f"--rerun {where}: must be a FILE.rrd, '{VIEWER}', or the address of a viewer such as "
            "rerun+http://127.0.0.1:9876/proxy"
        )
    if not Path(where).parent.is_dir():
        raise UserError(f"--rerun {where}: folder {Path(where).parent} does not exist")
    if Path(where).is_dir():
        raise UserError(f"--rerun {where}: is a folder; name a file")


def needed() -> Any:
    """The package rerun; raises UserError where it is missing."""
    # What goes wrong is said by who calls, in one sentence; the library logs it many times.
    os.environ.setdefault("RUST_LOG", "off")
    try:
        return importlib.import_module("rerun")
    except ImportError:
        raise UserError(
            '--rerun needs the package rerun-sdk; install it with: pip install "lndrl[rerun]" (in '
            'a clone pip install ".[rerun]")'
        ) from None


def record(snapshots: Sequence[WorldSnapshot], stream: Any) -> None:
    """Log all moments of an episode to a ``rerun.RecordingStream``."""
    course = course_of(snapshots)
    _log_still(snapshots[0], course, stream)
    for k, snapshot in enumerate(snapshots):
        stream.set_time("step", sequence=snapshot.steps)
        stream.set_time("sim_time", duration=snapshot.time)
        _log_frames(snapshot, stream)
        _log_belief(snapshot, stream)
        _log_people(snapshot, stream)
        _log_numbers(course, k, snapshot, stream)


def _log_still(snapshot: WorldSnapshot, course: Course, stream: Any) -> None:
    """What does not change: axes, walls, goal, and what series are called."""
    rr = needed()
    stream.log("map", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    rows, columns = snapshot.occupied.shape
    (x, y), size = snapshot.origin, snapshot.resolution
    corners = [[x, y, 0], [x + columns * size, y, 0]]
    corners += [[cx, y + rows * size, 0] for cx, _, _ in corners[::-1]]
    shades = np.array([_rgb(FLOOR), _rgb(WALL)], np.uint8)[snapshot.occupied.astype(int)]
    floor = rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        # Textures begin at their upper left corner, the grid at its lower left.
        vertex_texcoords=[[0, 1], [1, 1], [1, 0], [0, 0]],
        albedo_texture=shades[::-1],
    )
    stream.log("map/grid", floor, static=True)
    goal = snapshot.goal + snapshot.arrive_distance * _circle()
    stream.log("map/goal", rr.LineStrips3D([_raised(goal, 0.02)], colors=_rgb(GOAL)), static=True)
    for i, name in enumerate(course.part_names):
        colour = _rgb((*SERIES, WALL)[i % (len(SERIES) + 1)])
        stream.log(f"reward/{name}", rr.SeriesLines(names=name, colors=colour), static=True)
    for name, shade in (("position", TRUTH), ("angle", BELIEF)):
        stream.log(f"error/{name}", rr.SeriesLines(names=name, colors=_rgb(shade)), static=True)


def _log_frames(snapshot: WorldSnapshot, stream: Any) -> None:
    """Where odometry and filter have the robot, the scan as it sees it, and the truth."""
    rr = needed()
    odometry = snapshot.pose_odometry
    stream.log("map/odom", _transform(map_to_odom(snapshot)))
    stream.log("map/odom/base_link", _transform(odometry))
    stream.log("map/odom/base_link/body", _body(snapshot.robot_radius, BELIEF_DARK))
    echo = snapshot.scan < snapshot.range_max * 0.9999
    bearing = snapshot.field_of_view * (np.arange(len(snapshot.scan)) / len(snapshot.scan) - 0.5)
    beams = snapshot.scan[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    points = _raised(beams[echo].astype(np.float64), 0.1)
    scan = rr.Points3D(points, colors=_rgb(ECHO), radii=0.03)
    stream.log("map/odom/base_link/scan", scan)
    stream.log("map/base_link_true", _transform(snapshot.pose_true))
    stream.log("map/base_link_true/body", _body(snapshot.robot_radius, TRUTH))
    for name, path, shade in (
        ("path_true", snapshot.path, TRUTH),
        ("path_estimated", snapshot.path_estimated, BELIEF_DARK),
    ):
        strip = rr.LineStrips3D([_raised(path, 0.03)], colors=_rgb(shade), radii=0.02)
        stream.log(f"map/{name}", strip)


def _log_belief(snapshot: WorldSnapshot, stream: Any) -> None:
    """Particles, larger where heavier; the ellipse of two deviations; the second cluster."""
    rr = needed()
    particles = snapshot.particles
    weights = snapshot.weights if len(snapshot.weights) else np.ones(len(particles))
    mean = max(float(weights.mean()), 1e-300) if len(weights) else 1.0
    radii = 0.02 * np.sqrt(np.clip(weights / mean, 0.2, 9.0))
    cloud = rr.Points3D(_raised(particles[:, :2], 0.05), colors=_rgb(BELIEF), radii=radii)
    stream.log("map/particles", cloud)
    stream.log("map/particles/weight", rr.AnyValues(weight=weights))
    long, short, angle = deviation_ellipse(snapshot.covariance)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    ellipse = snapshot.pose_estimated[:2] + (_circle() * (long, short)) @ turn
    strip = rr.LineStrips3D([_raised(ellipse, 0.06)], colors=_rgb(BELIEF_DARK), radii=0.015)
    stream.log("map/covariance", strip)
    share, x, y = snapshot.clusters[1]
    places, labels = ([[x, y, 0.07]], [f"{share:.0%}"]) if share > 0.0 else ([], [])
    second = rr.Points3D(places, colors=_rgb(BELIEF_DARK), radii=0.12, labels=labels)
    stream.log("map/second_cluster", second)


def _log_people(snapshot: WorldSnapshot, stream: Any) -> None:
    rr = needed()
    at = _raised(snapshot.pedestrian_position, 0.1)
    radius = snapshot.pedestrian_radius
    stream.log("map/people", rr.Points3D(at, colors=(*_rgb(PERSON[""]), 120), radii=radius))
    walk = _raised(1.5 * snapshot.pedestrian_velocity, 0.0)
    arrows = rr.Arrows3D(vectors=walk, origins=at, colors=_rgb(LEG), radii=0.03)
    stream.log("map/people/velocity", arrows)
    legs = _raised(snapshot.leg_position, 0.1)
    stream.log("map/people/legs", rr.Points3D(legs, colors=_rgb(LEG), radii=snapshot.leg_radius))


def _log_numbers(course: Course, k: int, snapshot: WorldSnapshot, stream: Any) -> None:
    rr = needed()
    stream.log("error/position", rr.Scalars(course.position_error[k]))
    stream.log("error/angle", rr.Scalars(course.angle_error[k]))
    for i, name in enumerate(course.part_names):
        stream.log(f"reward/{name}", rr.Scalars(snapshot.parts[i]))
    if len(snapshot.probabilities):
        stream.log("policy/probabilities", rr.BarChart(snapshot.probabilities))
    if snapshot.action >= 0:
        stream.log("policy/action", rr.Scalars(snapshot.action))
    if snapshot.outcome:
        word = OUTCOME_WORD.get(snapshot.outcome, snapshot.outcome)
        level = "INFO" if snapshot.outcome == "arrived" else "ERROR"
        colour = _rgb(OUTCOME.get(snapshot.outcome, WALL))
        stream.log("outcome", rr.TextLog(f"{word} at {snapshot.time:.1f} s", level=level))
        here = [[*snapshot.pose_true[:2], 0.5]]
        stream.log("map/outcome", rr.Points3D(here, labels=[word], colors=colour, radii=0.15))


def map_to_odom(snapshot: WorldSnapshot) -> Floats:
    """Pose (3,) of the odom frame in the map: what the filter corrects the odometry by."""
    x, y, yaw = snapshot.pose_estimated
    ox, oy, turned = snapshot.pose_odometry
    angle = yaw - turned
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([x - cos * ox + sin * oy, y - sin * ox - cos * oy, angle])


def _transform(pose: Floats) -> Any:
    rr = needed()
    half = 0.5 * float(pose[2])
    turned = rr.Quaternion(xyzw=[0.0, 0.0, math.sin(half), math.cos(half)])
    return rr.Transform3D(translation=[pose[0], pose[1], 0.0], rotation=turned)


def _body(radius: float, colour: str) -> Any:
    """The robot's outline and where it looks."""
    nose = np.array([[0.0, 0.0], [2.1 * radius, 0.0]])
    strips = [_raised(radius * _circle(), 0.08), _raised(nose, 0.08)]
    return needed().LineStrips3D(strips, colors=_rgb(colour), radii=0.02)


def _circle() -> Floats:
    return np.stack([np.cos(_CIRCLE), np.sin(_CIRCLE)], axis=1)


def _raised(points: Floats, height: float) -> Floats:
    """Points (n, 2) as (n, 3), so high that nothing flickers where things lie on each other."""
    return np.column_stack([points, np.full(len(points), height)])


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue


def _name(snapshot: WorldSnapshot) -> str:
    return f"{snapshot.scenario}-{snapshot.world}-{snapshot.episode}"


def _layout() -> Any:
    """The map beside what changes over time."""
    blueprint = importlib.import_module("rerun.blueprint")
    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Spatial3DView(origin="map", name="map"),
            blueprint.Vertical(
                blueprint.TimeSeriesView(origin="error", name="pose error (m, rad)"),
                blueprint.TimeSeriesView(origin="reward", name="reward of each step"),
                blueprint.BarChartView(origin="policy/probabilities", name="actions"),
                blueprint.TextLogView(origin="outcome", name="outcome"),
            ),
            column_shares=[2, 1],
        )
    )
