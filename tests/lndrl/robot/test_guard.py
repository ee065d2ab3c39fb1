"""The guard: what it lets through never touches what was seen, and it lets a robot drive."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.localization import Scanner
from lndrl.planners.guard import GuardConfig
from lndrl.robot.adversaries import WAYS, Adversity, Arena, Tally, contest, square
from lndrl.robot.guard import CommandGuard, Sight, braked_evenly, moved_by
from lndrl.world.odometry import velocities

CHOICES = np.array([(v, w) for v in (0.0, 0.2, 0.4, 0.6) for w in (-0.9, -0.3, 0.0, 0.3, 0.9)])
BEAMS = 720
BEARINGS = math.pi * (np.arange(BEAMS) / BEAMS - 0.5)
STILL = (0.0, 0.0)
FAST = (0.6, 0.0)


def made(limits=None, grid=None, **bounds) -> CommandGuard:
    return CommandGuard(GuardConfig(**bounds), 0.17, limits, CHOICES, 0.4, 0.1, grid)


def post(x: float, y: float, radius: float = 0.1) -> np.ndarray:
    """Ranges of a round thing at x, y (m) and nothing else."""
    along = x * np.cos(BEARINGS) + y * np.sin(BEARINGS)
    inside = radius**2 - (x * x + y * y - along**2)
    hit = along - np.sqrt(np.maximum(inside, 0.0))
    return np.where((inside > 0.0) & (hit > 0.0), hit, 12.0)


def let(guard: CommandGuard, ranges, command=FAST, velocity=STILL, scanner=None, **more):
    sight = guard.look(ranges, BEARINGS, scanner or Scanner(), more.pop("pose", None))
    return guard.check(command, velocity, sight, **more)


def test_a_free_way_is_driven_as_asked() -> None:
    told, passed = let(made(), np.full(BEAMS, 12.0))
    assert passed and told == pytest.approx(FAST)


def test_it_stands_before_what_could_come() -> None:
    """Ahead, at what the formula of docs/guard.md says and not a centimetre before."""
    p = GuardConfig()
    # At the end of the period it has driven 0.24 m, and the body has come 0.2 m nearer.
    needed = 0.24 + 0.17 + p.noise + p.margin + p.body + p.people_speed * 0.4
    slack = (0.6 + p.people_speed) * 0.025  # of the samples' spacing
    guard = made()
    assert let(guard, post(needed + slack + 0.12, 0.0))[1]
    told, passed = let(guard, post(needed + 0.08, 0.0))
    assert not passed and told[0] < 0.6


def test_brakes_are_counted_in() -> None:
    for limits, more in ((None, 0.0), ((1.0, 1.0, 2.0), 0.18), ((1.0, 0.5, 2.0), 0.36)):
        guard = made(limits, people_speed=0.0, body=0.0)
        nearest = next(
            x for x in np.arange(0.3, 3.0, 0.005) if let(guard, post(x, 0.0, 0.02), FAST, FAST)[1]
        )
        # 0.24 m in the period, then v² / (2 a); the world brakes tick by tick, a little shorter.
        assert nearest == pytest.approx(0.24 + more + 0.17 + 0.08 + 0.02, abs=0.05)


def test_a_delay_and_an_old_scan_ask_for_more_room() -> None:
    def nearest(guard: CommandGuard, **more) -> float:
        return next(x for x in np.arange(0.3, 4.0, 0.01) if let(guard, post(x, 0.0), **more)[1])

    least = nearest(made())
    assert nearest(made(delay=0.4)) == pytest.approx(least + 0.2, abs=0.02)
    assert nearest(made(), age=0.4) == pytest.approx(least + 0.2, abs=0.02)
    moved = moved_by(FAST, 0.5)
    assert nearest(made(), moved=moved) == pytest.approx(least + 0.3, abs=0.02)


def test_it_takes_what_is_nearest_to_what_was_asked() -> None:
    told, passed = let(made(), post(1.1, 0.0))
    assert not passed and 0.0 < told[0] < 0.6
    # Somebody right before it: it may turn, not drive.
    told, passed = let(made(), post(0.4, 0.0), (0.4, 0.9))
    assert not passed and told == pytest.approx((0.0, 0.9))
    told, passed = let(made(), post(0.4, 0.0), (0.0, -0.3))
    assert passed


def test_what_the_map_explains_stands() -> None:
    """A wall may be neared as far as it goes; where the map says nothing the same is a body."""
    grid = square()
    pose = np.array([5.0, 0.0, 0.0])  # a metre from the wall at x = 6
    with np.errstate(divide="ignore"):
        ranges = np.minimum(1.0 / np.maximum(np.cos(BEARINGS), 1e-9), 12.0)
    near = np.minimum(ranges, np.abs(6.0 / np.sin(BEARINGS + 1e-9)))
    assert let(made(grid=grid), near, pose=pose)[1]
    assert not let(made(grid=grid), near)[1]  # nobody knows where it is
    assert not let(made(), near, pose=pose)[1]
    # Lost: the echoes are not where the map has walls, so they may be anything.
    assert not let(made(grid=grid), near, pose=np.array([2.0, 1.0, 2.0]))[1]
    # Somebody before the wall is not explained by it.
    both = np.minimum(near, post(0.7, 0.0))
    assert not let(made(grid=grid), both, pose=pose)[1]
    assert not let(made(grid=grid), near, pose=pose, moved=(0.6, 0.0, 0.0))[1]  # too near


def test_from_a_wall_it_may_leave_but_not_come_nearer() -> None:
    grid, guard = square(), made(grid=square())
    assert grid.mapped.any()
    pose = np.array([5.78, 0.0, 0.0])
    with np.errstate(divide="ignore"):
        ranges = np.minimum(0.22 / np.maximum(np.cos(BEARINGS), 1e-9), 6.0)
    assert not let(guard, ranges, (0.2, 0.0), pose=pose)[1]
    behind = np.array([5.78, 0.0, math.pi])
    aside = 6.0 / np.maximum(np.abs(np.sin(BEARINGS)), 1e-9)
    away = np.minimum(11.78 / np.maximum(np.cos(BEARINGS), 1e-9), aside)
    assert let(guard, away, (0.6, 0.0), pose=behind)[1]


def test_single_readings_and_nothing_are_no_bodies() -> None:
    ranges = np.full(BEAMS, 12.0)
    ranges[360] = 0.3
    assert let(made(), ranges)[1]
    ranges[361] = 0.35  # a neighbour bears it out
    assert not let(made(), ranges)[1]
    strange = np.full(BEAMS, math.nan)
    strange[::3], strange[1::3] = math.inf, 0.0
    assert let(made(), strange)[1]


def test_the_last_beam_of_a_full_turn_is_beside_the_first() -> None:
    """A leg behind a robot that looks all around may lie on the seam, a beam on either side."""
    around = 2.0 * math.pi * (np.arange(360) / 360 - 0.5)
    ranges = np.full(360, 12.0)
    ranges[[0, -1]] = 1.0, 1.1
    for upside_down in (False, True):
        bearings = -around if upside_down else around
        assert made().look(ranges, bearings, Scanner()).beam.tolist() == [0, 359]
    assert not len(made().look(ranges, 0.5 * around, Scanner()).beam)
    ranges[-1] = 1.4  # does not bear it out
    assert not len(made().look(ranges, around, Scanner()).beam)


def test_a_command_that_holds_for_part_of_a_tick_more_is_looked_at_to_its_end() -> None:
    def nearest(period: float) -> float:
        guard = CommandGuard(GuardConfig(), 0.17, None, CHOICES, period, 0.1)
        return next(x for x in np.arange(0.9, 2.0, 0.01) if let(guard, post(x, 0.0))[1])

    assert nearest(0.44) == nearest(0.5) > nearest(0.4) == nearest(0.1 + 0.1 + 0.1 + 0.1)


@pytest.mark.parametrize(("loss", "fastest"), [(1.0, 0.6), (1.0, 0.7), (2.5, 0.26), (0.3, 1.0)])
def test_steps_of_braking_are_no_shorter_than_braking(loss: float, fastest: float) -> None:
    limits = braked_evenly((1.0, loss, 2.0), fastest, 0.1)
    assert limits[0] == 1.0 and limits[2] == 2.0
    for v in np.linspace(0.05, fastest, 12):
        slower = velocities(np.array([v, 0.0]), np.zeros((1, 2)), limits, 0.1, 60)[0, :, 0]
        short = v * v / (2.0 * loss) - 0.1 * slower.sum()
        assert short <= (fastest * 0.1 / 8.0 if v < fastest else 0.0) + 1e-9
    at_once = (math.inf, math.inf, math.inf)
    assert braked_evenly(at_once, 0.6, 0.1) == at_once


def test_a_scanner_off_the_centre_and_upside_down() -> None:
    ahead = post(1.0, 0.0)
    guard = made()
    assert not let(guard, ahead)[1]
    assert let(guard, ahead, scanner=Scanner(x=0.5))[1]
    assert not let(guard, post(1.45, 0.0), scanner=Scanner(x=-0.5))[1]


def test_commands_that_are_no_numbers_stop_it() -> None:
    for command in ((math.nan, 0.0), (0.6, math.inf)):
        told, passed = let(made(), np.full(BEAMS, 12.0), command)
        assert not passed and told == pytest.approx(STILL)


CASES = st.builds(
    Adversity,
    bodies=st.integers(1, 8),
    beams=st.sampled_from([90, 180, 360]),
    field_of_view=st.sampled_from([math.pi / 2, math.pi, 2 * math.pi]),
    latency=st.integers(0, 3),
    limits=st.sampled_from([None, (1.0, 1.0, 2.0), (0.5, 0.3, 1.0), (2.0, 4.0, 9.0)]),
    fastest=st.sampled_from([0.22, 0.6, 1.0]),
    ways=st.lists(st.sampled_from(WAYS), min_size=1, max_size=5).map(tuple),
)


@settings(max_examples=25, deadline=None)
@given(
    made=CASES,
    speed=st.sampled_from([0.3, 0.5, 1.5]),
    body=st.sampled_from([0.2, 0.4, 0.6]),
    seed=st.integers(0, 2**32 - 1),
)
def test_nothing_that_was_seen_is_ever_touched(
    made: Adversity, speed: float, body: float, seed: int
) -> None:
    bounds = GuardConfig(people_speed=speed, body=body, delay=made.latency * made.tick)
    tally = contest(400, made, bounds, seed)
    assert tally.steps == 400
    assert tally.seen == 0 and tally.walls == 0


@settings(max_examples=6, deadline=None)
@given(made=CASES, holds=st.integers(2, 6), seed=st.integers(0, 2**32 - 1))
def test_nor_where_commands_are_revised_before_they_are_over(
    made: Adversity, holds: int, seed: int
) -> None:
    """As ``lndrl drive`` does with every scan; what is let through may be ended after any tick."""
    made = replace(made, ticks_per_step=1, holds=holds)
    tally = contest(300, made, GuardConfig(delay=made.latency * made.tick), seed)
    assert tally.seen == 0 and tally.walls == 0


def test_choices_of_the_moment_and_what_is_liked_best() -> None:
    guard, ahead = made(), post(0.9, 0.0)
    slow = np.array([(0.1, 0.0), (0.0, 0.9), (0.0, -0.9)])
    told, passed = let(guard, ahead, choices=lambda: slow, scores=[0.2, 0.3, 0.5])
    assert not passed and told == pytest.approx((0.0, -0.9))
    told, passed = let(guard, ahead, choices=lambda: slow)
    assert not passed and any((told == each).all() for each in slow)


def test_without_the_guard_they_are_touched() -> None:
    """The adversaries are worth the name, and it is the guard that keeps the robot from them."""
    tally = contest(400, Adversity(), GuardConfig(), 1, guard=False)
    assert tally.seen > 20
    broken = GuardConfig(body=0.0, people_speed=0.0, noise=0.0)
    arena = Arena(GuardConfig(), Adversity(), np.random.default_rng(1))
    arena.guard = CommandGuard(broken, 0.17, None, arena.choices, 0.4, 0.1, square())
    for _ in range(400):
        arena.step()
    assert arena.tally.seen > 5


def test_what_the_guard_overlooks_is_counted_all_the_same() -> None:
    """Whether a body was shown is asked of the world, not of what is tested by it."""
    arena = Arena(GuardConfig(), Adversity(bodies=4), np.random.default_rng(1))
    nothing = Sight(np.zeros((0, 2)), np.zeros(0, np.bool_), np.zeros(0, np.int64))
    arena.guard.look = lambda *_: nothing  # type: ignore[method-assign]
    for _ in range(150):
        arena.step()
    assert arena.tally.seen > 3


def test_it_lets_the_robot_drive() -> None:
    """Among four people who wander it stands for less than a fifth; alone hardly ever."""
    busy = Tally()
    for seed in range(3):
        tally = contest(300, Adversity(bodies=4, ways=("wander", "stand")), GuardConfig(), seed)
        for name, value in vars(tally).items():
            setattr(busy, name, getattr(busy, name) + value)
    assert busy.seen == busy.walls == 0
    assert busy.goals > 15 and busy.standing < 0.2
    alone = contest(300, Adversity(bodies=0), GuardConfig(), 0)
    assert alone.goals > 8 and alone.standing < 0.02 and alone.walls == 0


def test_the_same_seed_is_the_same_contest() -> None:
    first, second = (contest(50, Adversity(), GuardConfig(), 7).to_dict() for _ in range(2))
    assert first == second
