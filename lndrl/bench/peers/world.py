"""Whole simulators on one scene: a differential-drive robot with a lidar of 720 beams over 180
degrees and 12 m, 22 ORCA pedestrians and the 25 boxes of the laser's room, 0.1 s a tick.

None of them has localization, legs, wheel slip or the beam model's maximum and random readings.
"""

from __future__ import annotations

import importlib
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from lndrl.bench.laser import SIZE, Scene, alternate, make_scene

Case = Callable[[], None]

PEDESTRIANS = 22
TICK = 0.1
TICKS_PER_STEP = 4
"""Ticks of a control step of 0.4 s."""
_ROBOT_RADIUS = 0.17
_PEDESTRIAN_RADIUS = 0.3
_SPEED = 0.5
_HORIZON = 5.0
_COMMAND = (0.4, 0.15)  # m/s, rad/s
_SHARED = "ir-sim and irsim-x share the module irsim"


class _NotInstalledError(Exception):
    pass


def measure_peers(seconds: float) -> dict[str, Any]:
    """``ticks_per_second`` and ``control_steps_per_second`` (4 ticks) of each simulator.

    They take turns in one process on one core. A peer that breaks has one entry, ``failed``.
    """
    scene = make_scene()
    figures: dict[str, Any] = {}
    cases: dict[str, Case] = {}
    ticks = {"irsim": 10, "irsim_x": 10, "navground": 50}
    for name, make in _PEERS.items():
        try:
            step = make(scene)
            step()
        except _NotInstalledError as error:
            figures[name] = {"missing": str(error)}
        except Exception as error:
            figures[name] = {"failed": f"{type(error).__name__}: {error}"}
        else:
            cases[name] = _repeat(step, ticks[name])
    for name, once in alternate(cases, seconds).items() if cases else ():
        rate = ticks[name] / once
        figures[name] = {
            "ticks_per_second": rate,
            "control_steps_per_second": rate / TICKS_PER_STEP,
        }
    return figures


def _repeat(step: Case, ticks: int) -> Case:
    def run() -> None:
        for _ in range(ticks):
            step()

    return run


def _positions(scene: Scene, count: int) -> list[list[float]]:
    """The first ``count`` places of the scene that are 1 m from each other and 0.3 m from walls."""
    chosen: list[list[float]] = []
    for x, y, _ in scene.poses:
        if all(math.hypot(x - a, y - b) > 1.0 for a, b in chosen):
            chosen.append([float(x), float(y)])
    if len(chosen) < count:
        raise ValueError(f"the scene has room for {len(chosen)} of {count}")
    return chosen[:count]


def _corners(scene: Scene) -> list[list[list[float]]]:
    boxes: list[list[float]] = scene.boxes.tolist()
    return [[[x0, y0], [x1, y0], [x1, y1], [x0, y1]] for x0, y0, x1, y1 in boxes]


def _irsim_module(x: bool) -> Any:
    """The module irsim if it is the wanted one of the two packages that bring it."""
    name, other = ("irsim-x", "ir-sim") if x else ("ir-sim", "irsim-x")
    try:
        module = importlib.import_module("irsim")
    except ImportError as error:
        raise _NotInstalledError(f"pip install {name}") from error
    environment = importlib.import_module("irsim.env.env_base")
    if hasattr(environment, "CppSim") is not x:
        raise _NotInstalledError(
            f"{_SHARED}, and {other} is the one found; "
            f"pip install --no-deps --target DIR {name} and set PYTHONPATH=DIR"
        )
    return module


def _irsim_scene(scene: Scene, x: bool) -> dict[str, Any]:
    """Its world file: rectangles as polygons; agents do not stop where they touch.

    irsim-x steers groups of robots only, so there the pedestrians are robots without sensors.
    """
    width, height = SIZE
    start, *people = _positions(scene, 1 + PEDESTRIANS)
    goals = [*people[1:], people[0]]
    lidar = {
        "name": "lidar2d",
        "range_min": 0,
        "range_max": 12,
        "angle_range": math.pi,
        "number": 720,
        "noise": True,
        "std": 0.02,
    }
    walls = [
        {"shape": {"name": "linestring", "vertices": line}, "state": [0, 0, 0]}
        for line in [
            [[0, 0], [width, 0]],
            [[width, 0], [width, height]],
            [[width, height], [0, height]],
            [[0, height], [0, 0]],
        ]
    ]
    boxes = [
        {"shape": {"name": "polygon", "vertices": corners}, "state": [0, 0, 0]}
        for corners in _corners(scene)
    ]
    robot = {
        "kinematics": {"name": "diff"},
        "shape": {"name": "circle", "radius": _ROBOT_RADIUS},
        "state": [*start, 0.0],
        "goal": [*people[0], 0.0],
        "vel_max": [0.6, 0.9],
        "sensors": [lidar],
    }
    crowd = {
        "number": PEDESTRIANS,
        "distribution": {"name": "manual"},
        "kinematics": {"name": "omni"},
        "shape": {"name": "circle", "radius": _PEDESTRIAN_RADIUS},
        "state": [[*at, 0.0] for at in people],
        "goal": [[*at, 0.0] for at in goals],
        "vel_max": [_SPEED, _SPEED],
        "group_behavior": {
            "name": "orca",
            "neighborDist": _HORIZON,
            "maxNeighbors": 10,
            "timeHorizon": _HORIZON,
            "timeHorizonObst": _HORIZON,
            "maxSpeed": _SPEED,
        },
    }
    world = {
        "width": width,
        "height": height,
        "step_time": TICK,
        "sample_time": TICK,
        "collision_mode": "unobstructed",
    }
    return {
        "world": world,
        "robot": [robot, crowd] if x else [robot],
        "obstacle": [*boxes, *walls] if x else [crowd, *boxes, *walls],
    }


def _irsim(scene: Scene, x: bool) -> Case:
    module = _irsim_module(x)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(yaml.safe_dump(_irsim_scene(scene, x)), encoding="utf-8")
        environment = module.make(
            str(path), display=False, disable_all_plot=True, log_level="ERROR"
        )
    command = np.array(_COMMAND)[:, None]

    def step() -> None:
        environment.step(command)

    movers = environment.robot_list[1:] if x else environment.obstacle_list
    people = [each for each in movers if not each.static]
    before = [each.state[:2, 0].copy() for each in people]
    for _ in range(5):
        step()
    moved = [
        np.hypot(*(each.state[:2, 0] - at)) > 0.01 for each, at in zip(people, before, strict=True)
    ]
    beams = len(environment.get_lidar_scan()["ranges"])
    if len(people) != PEDESTRIANS or sum(moved) < PEDESTRIANS // 2 or beams != 720:
        raise ValueError(f"{len(people)} pedestrians, {sum(moved)} of them moving, {beams} beams")
    return step


def _navground(scene: Scene) -> Case:
    """Its lidar is not looked at by agents that steer by ORCA: each tick updates it explicitly."""
    try:
        core = importlib.import_module("navground.core")
        sim = importlib.import_module("navground.sim")
    except ImportError as error:
        raise _NotInstalledError("pip install navground") from error
    sim.load_plugins()
    width, height = SIZE
    outlines = [*_corners(scene), [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]]
    world = sim.World()
    for outline in outlines:
        for a, b in zip(outline, [*outline[1:], outline[0]], strict=True):
            world.add_wall(core.LineSegment(a, b))
    places = _positions(scene, 1 + PEDESTRIANS)
    agents = []
    for i, at in enumerate(places):
        robot = i == 0
        kinematics = core.Kinematics.make_type("2WDiff" if robot else "Omni")
        kinematics.max_speed = _SPEED
        if robot:
            kinematics.wheel_axis = 2 * _ROBOT_RADIUS
        behavior = core.Behavior.make_type("ORCA")
        behavior.optimal_speed = _SPEED
        behavior.horizon = _HORIZON
        behavior.time_horizon = _HORIZON
        agent = sim.Agent(
            radius=_ROBOT_RADIUS if robot else _PEDESTRIAN_RADIUS,
            behavior=behavior,
            kinematics=kinematics,
            task=sim.tasks.WaypointsTask(waypoints=places, loop=True, random=True, tolerance=0.3),
            state_estimations=[sim.state_estimations.BoundedStateEstimation(range=10.0)],
            control_period=TICK,
        )
        agent.position = at
        world.add_agent(agent)
        agents.append(agent)
    lidar = sim.state_estimations.LidarStateEstimation(
        range=12.0,
        start_angle=-math.pi / 2,
        field_of_view=math.pi,
        resolution=720,
        error_std_dev=0.02,
    )
    state = core.SensingState()
    lidar.prepare(agents[0], world)
    lidar.prepare_state(state)

    def step() -> None:
        world.update(TICK)
        lidar.update(agents[0], world, state)

    before = np.array([agent.position for agent in agents])
    for _ in range(5):
        step()
    moved = np.hypot(*(np.array([agent.position for agent in agents]) - before).T) > 0.01
    ranges = np.array(lidar.read_ranges(state))
    if len(ranges) != 720 or not ranges.std() > 0 or moved.sum() < PEDESTRIANS // 2:
        raise ValueError(f"{moved.sum()} agents moving, {len(ranges)} ranges")
    return step


_PEERS: dict[str, Callable[[Scene], Case]] = {
    "irsim": lambda scene: _irsim(scene, x=False),
    "irsim_x": lambda scene: _irsim(scene, x=True),
    "navground": _navground,
}
