import numpy as np
import pytest

from lndrl.config import CrowdConfig
from lndrl.maps import distance_field
from lndrl.maps.raycast import sample_field
from lndrl.world.pedestrians import GAIT, ORCA, SFM, Crowd, walls_for
from lndrl.world.people import make_people

RESOLUTION = 0.05
FAR_ROBOT = np.array([9.0, 9.0, 0.0])
STILL = np.zeros(2)


def field_with_wall():
    occupied = np.zeros((200, 200), dtype=bool)
    occupied[:2] = occupied[-2:] = True
    occupied[:, :2] = occupied[:, -2:] = True
    occupied[100:104, 40:160] = True  # y 5.0 .. 5.2, x 2 .. 8
    return distance_field(occupied, RESOLUTION)


FIELD = field_with_wall()


def crowd_of(routes, models, shuttle=False, config=None):
    crowd = Crowd(len(routes), 4, config or CrowdConfig(), 0.1)
    crowd.count = len(routes)
    for i, (route, model) in enumerate(zip(routes, models, strict=True)):
        crowd.route[i, : len(route)] = route
        crowd.route_length[i] = len(route)
        crowd.target[i] = 1
        crowd.position[i] = route[0]
        crowd.model[i] = model
        crowd.shuttle[i] = shuttle
    crowd.place_legs()
    return crowd


def advance(crowd, ticks, robot=FAR_ROBOT, command=STILL):
    for _ in range(ticks):
        crowd.advance(robot, command, FIELD, 1.0 / RESOLUTION)


@pytest.mark.parametrize("model", [ORCA, SFM])
def test_a_lone_pedestrian_walks_its_waypoints_and_stays(model):
    crowd = crowd_of([[(1.0, 1.0), (4.0, 1.0), (4.0, 3.0)]], [model])
    advance(crowd, 50)
    # The social force keeps away from the wall at y = 0.1, ORCA does not know it.
    drift = 0.05 if model == ORCA else 0.5
    assert crowd.target[0] == 1 and crowd.position[0, 1] == pytest.approx(1.0, abs=drift)
    speed = np.hypot(*crowd.velocity[0])
    assert 0.4 < speed <= 0.5 + 1e-9
    advance(crowd, 150)
    assert crowd.position[0] == pytest.approx([4.0, 3.0], abs=0.25)
    assert crowd.target[0] == 2
    assert np.hypot(*crowd.velocity[0]) < 0.25


@pytest.mark.parametrize("models", [(ORCA, ORCA), (SFM, SFM), (ORCA, SFM), (SFM, ORCA)])
def test_two_at_one_point_part_in_opposite_directions(models):
    way = [(1.0, 1.0), (1.0, 4.5)]
    crowd = crowd_of([way, way], models)
    crowd.velocity[:2] = 0.0, 0.4
    advance(crowd, 1)
    left, right = crowd.velocity[:2].copy()
    assert left[0] < -0.05 and right[0] > 0.05
    if models[0] == models[1]:
        assert left == pytest.approx([-right[0], right[1]], abs=0.05)
    advance(crowd, 15)
    assert np.hypot(*(crowd.position[0] - crowd.position[1])) > 0.4
    again = crowd_of([way, way], models)
    again.velocity[:2] = 0.0, 0.4
    advance(again, 16)
    assert (again.position == crowd.position).all()


def test_a_shuttle_turns_around_at_both_ends():
    crowd = crowd_of([[(1.0, 1.0), (2.5, 1.0), (2.5, 2.5)]], [ORCA], shuttle=True)
    visits: list[str] = []
    for _ in range(300):
        advance(crowd, 1)
        for name, end in (("start", (1.0, 1.0)), ("goal", (2.5, 2.5))):
            near = np.hypot(*(crowd.position[0] - end)) < 0.25
            if near and (not visits or visits[-1] != name):
                visits.append(name)
    assert visits[:4] == ["start", "goal", "start", "goal"]


@pytest.mark.parametrize("model", [ORCA, SFM])
def test_nobody_enters_a_wall(model):
    # The goal lies behind a wall: they must stop or slide, never enter.
    crowd = crowd_of([[(x, 3.0), (x + 0.7, 8.0)] for x in (3.0, 4.5, 6.0)], [model] * 3)
    for _ in range(300):
        advance(crowd, 1)
        assert (crowd.position[:3, 1] <= 5.0 - 0.2 + 1e-6).all()


@pytest.mark.parametrize("model", [ORCA, SFM])
@pytest.mark.parametrize("goal", [(12.0, 12.5), (-3.0, 9.0), (5.5, -2.0), (12.0, 1.0)])
def test_nobody_is_pushed_into_walls_or_corners(model, goal):
    crowd = crowd_of([[(8.7, 8.5), goal], [(1.0, 1.2), goal], [(5.0, 5.5), goal]], [model] * 3)
    for _ in range(250):
        advance(crowd, 1)
        room = [sample_field(FIELD, 1.0 / RESOLUTION, *p) for p in crowd.position[:3]]
        assert min(room) >= 0.2


def test_pedestrians_give_way_to_the_robot_only_when_they_see_it():
    for model in (ORCA, SFM):
        offsets = []
        for see in (True, False):
            config = CrowdConfig(see_robot=see, orca_neighbor_distance=3.0, orca_radius=0.3)
            crowd = crowd_of([[(1.0, 2.0), (7.0, 2.0)]], [model], config=config)
            aside = 0.0
            for _ in range(100):
                advance(crowd, 1, np.array([4.0, 1.95, 0.0]))
                aside = max(aside, abs(crowd.position[0, 1] - 2.0))
            offsets.append(aside)
        assert offsets[0] > 0.1
        assert offsets[0] > offsets[1] + 0.08


def test_order_of_pedestrians_does_not_matter():
    rng = np.random.default_rng(3)
    routes = [[tuple(rng.uniform(1, 4, 2)), tuple(rng.uniform(1, 4, 2))] for _ in range(8)]
    models = list(rng.integers(0, 2, 8))
    forward = crowd_of(routes, models)
    backward = crowd_of(routes[::-1], models[::-1])
    advance(forward, 20)
    advance(backward, 20)
    assert forward.position[:8] == pytest.approx(backward.position[:8][::-1], abs=1e-6)


@pytest.mark.parametrize("heading", [np.pi / 2, 0.0, 2.5])
def test_gait_goes_through_eight_phases_with_legs_mirrored(heading):
    assert GAIT.tolist() == [0, 0.5, 1, 0.5, 0, -0.5, -1, -0.5]
    crowd = crowd_of([[(2.0, 3.0), (8.0, 3.0)]], [ORCA])
    crowd.heading[0] = heading
    ahead = np.array([np.cos(heading), np.sin(heading)])
    aside = np.array([-ahead[1], ahead[0]])  # to the left
    for phase in range(16):
        crowd.travelled[0] = (phase + 0.01) * 0.3
        crowd.place_legs()
        forward = 0.3 * GAIT[phase % 8] * ahead
        assert crowd.legs[0] == pytest.approx([2.0, 3.0] + 0.1 * aside - forward)
        assert crowd.legs[1] == pytest.approx([2.0, 3.0] - 0.1 * aside + forward)


def test_the_phase_advances_every_step_length_walked_and_rests_when_standing():
    crowd = crowd_of([[(1.0, 2.0), (5.0, 2.0)]], [ORCA])
    advance(crowd, 10)
    walked = crowd.position[0, 0] - 1.0
    assert crowd.travelled[0] == pytest.approx(walked, abs=1e-9)
    advance(crowd, 300)
    legs = crowd.legs.copy()
    advance(crowd, 20)
    assert crowd.legs == pytest.approx(legs, abs=0.05)


def test_legs_follow_the_walking_direction():
    crowd = crowd_of([[(5.0, 1.0), (1.0, 1.0)]], [ORCA])
    advance(crowd, 5)
    assert abs(crowd.heading[0]) == pytest.approx(np.pi, abs=1e-6)
    left, right = crowd.legs[:2]
    assert left[1] - right[1] == pytest.approx(-0.2, abs=1e-6)  # walking -x: left is -y


OUTER = np.array([(0.1, 0.1), (0.1, 9.9), (9.9, 9.9), (9.9, 0.1)])
BAR = np.array([(2.0, 5.0), (8.0, 5.0), (8.0, 5.2), (2.0, 5.2)])


def busy_crowd(seed, state=None, people=16, **settings):
    """People of both models who walk to and fro through the room with the bar."""
    rng = np.random.default_rng(seed)
    config = CrowdConfig(**settings)
    crowd = Crowd(people, 4, config, 0.1, walls_for([OUTER, BAR], config), state)
    crowd.count = people
    crowd.route[:] = rng.uniform(0.6, 9.4, (people, 4, 2))
    for i in range(people):
        inside = (np.abs(crowd.route[i, :, 1] - 5.1) < 0.5) & (crowd.route[i, :, 0] > 1.6)
        crowd.route[i, inside, 1] += 1.2
    crowd.route_length[:] = 4
    crowd.position[:people] = crowd.route[:, 0]
    crowd.target[:] = 1
    crowd.direction[:] = 1
    crowd.shuttle[:] = True
    crowd.model[:] = np.arange(people) % 2
    crowd.travelled[:] = rng.uniform(0, 2.4, people)
    return crowd


@pytest.mark.parametrize("walls", [True, False])
def test_nobody_enters_walls_in_an_hour_of_pushing(walls):
    crowd = busy_crowd(7, orca_walls=walls)
    at = np.zeros((0, 2))
    for _ in range(360):
        advance(crowd, 100, np.array([5.0, 3.0, 0.0]))
        at = np.vstack([at, crowd.position[:16]])
    room = [sample_field(FIELD, 1.0 / RESOLUTION, *p) for p in at]
    assert min(room) >= 0.2
    assert np.median(crowd.travelled) > 300.0  # some routes lead through the bar, not all


def test_orca_keeps_to_walls_by_itself_only_when_it_knows_them():
    """``_walk`` stops feet at a wall; with walls ORCA turns before."""
    slowed = []
    for walls in (True, False):
        config = CrowdConfig(orca_walls=walls, see_robot=False)
        crowd = Crowd(1, 2, config, 0.1, walls_for([OUTER, BAR], config))
        crowd.count = 1
        crowd.route[0] = [(5.0, 3.0), (5.0, 8.0)]
        crowd.route_length[0], crowd.target[0] = 2, 1
        crowd.position[0] = 5.0, 4.2
        advance(crowd, 8)
        slowed.append(np.hypot(*crowd.velocity[0]) < 0.2)
    assert slowed == [True, False]


def test_one_seed_replays_one_crowd_bit_for_bit_in_its_own_or_given_arrays():
    states = make_people(3, 16, 4)
    crowds = [busy_crowd(3), busy_crowd(3, states.world(1)), busy_crowd(4)]
    for crowd in crowds:
        advance(crowd, 400)
    same, given, other = (c.people for c in crowds)
    for a, b in zip(same, given, strict=True):
        assert a.tobytes() == b.tobytes()
    assert same.position.tobytes() != other.position.tobytes()
    assert states.position[1].tobytes() == same.position.tobytes()
    assert not states.position[[0, 2]].any()


def test_two_who_meet_head_on_pass():
    """Exactly opposite ways: without keeping right, pushed straight back for ever."""
    passed = []
    for veer in (0.5, 0.0):
        config = CrowdConfig(orca_veer=veer, see_robot=False)
        ends = [(1.0, 2.0), (7.0, 2.0)]
        crowd = crowd_of([ends, ends[::-1]], [ORCA, ORCA], config=config)
        advance(crowd, 300)
        passed.append(crowd.position[0, 0] > 6.5 and crowd.position[1, 0] < 1.5)
    assert passed == [True, False]
