"""The careful planner with a map: its prices, where it goes, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation import EpisodeRunner
from lndrl.maps.localizability import HEADINGS, LocalizabilityField, Sensor, deviation_at, grid_hash
from lndrl.models import validate
from lndrl.navigation import Navigation, Observation
from lndrl.planners import CarefulMapConfig, CarefulMapPlanner, CarefulPlanner, planner_source
from lndrl.planners.careful_map import map_prices, moved
from lndrl.world import Place

SENSOR = Sensor(beams=60, field_of_view=np.pi, range_max=12.0, sigma=0.2, farthest=2.0)


def config_of(**changes) -> RunConfig:
    scenario = {
        "name": "hall",
        "size": [12, 10],
        "pedestrians": {"count": [0, 0]},
        "robot": [{"start": [1.4, 4.8, 1.6, 5.2], "goal": [10.4, 4.8, 10.6, 5.2], "both_ways": 0}],
    }
    localization = {"min_particles": 100, "max_particles": 300, "delay": 1}
    return RunConfig.model_validate({"scenario": scenario, "localization": localization, **changes})


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return config_of()


@pytest.fixture(scope="module")
def place(config) -> Place:
    return Place.build(config.scenario)


def field_of(place: Place, deviation: float = 0.05) -> LocalizabilityField:
    width, height = place.grid.size
    shape = (round(height / 0.25), round(width / 0.25))
    return LocalizabilityField(
        np.full((*shape, HEADINGS), deviation, np.float32), np.ones(shape, bool), 0.25, (0.0, 0.0),
        SENSOR, grid_hash(place.grid),
    )  # fmt: skip


def slow_prices(field, more, pose, firsts, ends, sure, unsure, look, way):
    """Pair by pair, with matrices."""
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])

    def doubt(there):
        x, y = pose[:2] + turn @ there[:2]
        return np.clip(field.at(x, y, pose[2] + there[2]), sure, unsure) - sure

    def left(there):
        u, v = np.clip(
            (pose[:2] + turn @ there[:2]) / 0.25 - 0.5, 0, np.array(more.shape)[::-1] - 1
        )
        c, r = int(u), int(v)
        square = more[r : r + 2, c : c + 2]
        across = square[:, 0] + (u - c) * (square[:, -1] - square[:, 0])
        return across[0] + (v - r) * (across[-1] - across[0])

    return np.array(
        [
            [look * (doubt(first) + doubt(end)) / 2 + way * left(end) for end in row]
            for first, row in zip(firsts, ends, strict=True)
        ]
    )


def test_a_slow_twin_finds_the_same_prices(place) -> None:
    rng = np.random.default_rng(2)
    field = field_of(place)
    field.deviation[:] = rng.uniform(0.04, 0.8, field.deviation.shape)
    more = rng.uniform(0, 5, field.free.shape)
    for pose in ([3.0, 4.0, 0.5], [0.2, 9.9, -8.0], [-1.0, 40.0, 2.0]):
        firsts, ends = rng.uniform(-1, 1, (4, 3)), rng.uniform(-2, 2, (4, 4, 3))
        out = np.ones((4, 4))
        map_prices(
            field.deviation, more, 4.0, 2.0, np.array(pose), firsts, ends, 0.1, 0.5, 7.0, 3.0, out
        )
        slow = slow_prices(field, more, np.array(pose), firsts, ends, 0.1, 0.5, 7.0, 3.0)
        assert out - 1.0 == pytest.approx(slow, rel=1e-6)


def test_poses_that_are_no_numbers_and_small_arrays_do_no_harm(place) -> None:
    field = field_of(place)
    assert deviation_at(field.deviation, 4.0, 0.0, 0.0, 2.0, np.nan, 1.0, 0.0) == 2.0
    out = np.zeros((2, 2))
    for pose in ([np.nan, 1.0, 0.0], [1.0, np.inf, 0.0], [1.0, 1.0, np.nan]):
        map_prices(
            field.deviation, np.zeros((1, 1)), 4.0, 2.0, np.array(pose), np.zeros((9, 3)),
            np.zeros((9, 9, 3)), 0.1, 0.5, 7.0, 3.0, out,
        )  # fmt: skip
    assert np.isfinite(out).all()


def test_moves_are_arcs() -> None:
    pose = np.array([1.0, 2.0, 0.3])
    small = pose
    for _ in range(1000):
        small = small + np.array([0.5 * np.cos(small[2]), 0.5 * np.sin(small[2]), 0.8]) * 0.001
    assert moved(pose, 0.5, 0.8, 1.0) == pytest.approx(small, abs=1e-3)
    assert moved(pose, 0.5, 0.0, 2.0) == pytest.approx(
        pose + np.array([np.cos(0.3), np.sin(0.3), 0.0])
    )


def drive(config: RunConfig, planner) -> tuple[np.ndarray, str]:
    class Source:
        def build(self, config: RunConfig, greedy: bool = False):
            return planner

    path: list[np.ndarray] = []

    def watch(world: Navigation) -> None:
        path.append(world.world.pose_true.copy())

    (record,) = EpisodeRunner(Source(), config)([0], watch)  # type: ignore[arg-type]
    return np.array(path), record.outcome


def test_where_the_map_tells_nothing_new_it_drives_like_careful(config, place) -> None:
    free = {"look_weight": 0.0, "way_weight": 0.0}
    careful, _ = drive(config, CarefulPlanner(config))
    same, _ = drive(config, CarefulMapPlanner(config, CarefulMapConfig(**free)))
    even, _ = drive(config, CarefulMapPlanner(config, field=field_of(place, 0.2)))
    assert (careful == same).all()
    assert np.abs(even[:, 1] - 5.0).max() < np.abs(careful[:, 1] - 5.0).max() + 0.3


def test_it_goes_round_where_scans_tell_little(config, place) -> None:
    """A band across the straight way, open at the top: a bend of 2 m."""
    field = field_of(place)
    field.deviation[:26, 18:30] = 1.0
    straight, _ = drive(config, CarefulPlanner(config))
    bent, outcome = drive(config, CarefulMapPlanner(config, field=field))
    assert outcome == "arrived"
    band = (bent[:, 0] > 5.0) & (bent[:, 0] < 7.0)
    assert straight[:, 1].max() < 6.0 and bent[band, 1].min() > 6.0


def test_a_place_is_studied_once(config, place, monkeypatch) -> None:
    planner, studied = CarefulMapPlanner(config), []
    study = planner._study

    def noted(each):
        studied.append(each)
        return study(each)

    monkeypatch.setattr(planner, "_study", noted)
    for _ in range(2):
        planner.reset(0, [0, 1, 2])
        planner.enter([place] * 3)
    assert studied == [place]


def test_what_it_refuses(config, place) -> None:
    with pytest.raises(UserError, match=r"^careful\+map: localization perfect has no variances"):
        planner_source("careful+map").build(config_of(localization={"kind": "perfect"}))
    planner = CarefulMapPlanner(config)
    planner.reset(0, [0])
    with pytest.raises(UserError, match=r"^careful\+map: needs the place and the pose"):
        planner.act(Observation.zeros_for(1, config), np.arange(1))
    other = Place.build(config_of().scenario.model_copy(update={"size": (13.0, 10.0)}))
    planner = CarefulMapPlanner(config, field=field_of(other))
    planner.reset(0, [0])
    with pytest.raises(UserError, match=r"^careful\+map: the localizability field is of map"):
        planner.enter([place])


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"sure": 2.0}, "sure must be below unsure (1.5), not 2"),
        ({"look_weight": -1.0}, "look_weight"),
        ({"look_wieght": 1.0}, "did you mean look_weight?"),
    ],
)
def test_parameters_are_checked(settings, sentence) -> None:
    with pytest.raises(UserError) as caught:
        validate(CarefulMapConfig, settings, "careful+map")
    assert sentence in str(caught.value)
