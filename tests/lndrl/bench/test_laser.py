import numpy as np
import pytest

from lndrl.bench.laser import Scene, alternate, errors, make_scene, measure
from lndrl.bench.peers import laser as peers


def test_figures_are_there_and_ranges_are_exact():
    figures = measure(0.001)
    for key in ("beams_per_second", "beams_per_second_from_python", "ray_march_beams_per_second"):
        assert figures[key] > 0
    assert 0 < figures["sparse_scan_microseconds"] < figures["scan_microseconds_20_bodies"]
    assert figures["p95_error_metres"] < 1e-4
    assert 1e-4 < figures["p95_error_to_boxes_metres"] < 0.05  # boxes are not made of cells


def test_the_room_is_always_the_same_and_its_poses_are_free():
    one, other = make_scene(), make_scene()
    assert (one.grid.occupied == other.grid.occupied).all() and (one.poses == other.poses).all()
    assert one.grid.shape == (400, 660)
    assert not any(one.grid.occupied[one.grid.index(x, y)] for x, y, _ in one.poses)


def test_wrong_ranges_have_errors():
    scene: Scene = make_scene()
    ranges = [scene.laser.true_ranges(pose, np.zeros((0, 2)), 0.1) for pose in scene.poses]
    assert errors(scene, [r + 0.5 for r in ranges])["median_error_metres"] == pytest.approx(0.5)


def test_cases_take_turns():
    calls = []
    alternate({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 0.0)
    assert "".join(calls) == "ab" * 16  # once to compile


def test_a_peer_that_is_missing_or_fails_says_so(monkeypatch):
    def missing(scene):
        raise ModuleNotFoundError("nowhere")

    def broken(scene):
        raise ValueError("of another version")

    monkeypatch.setattr(
        peers, "_peers", lambda: [("one", missing, "pip install one"), ("two", broken, "")]
    )
    assert peers.measure_peers(0.001) == {
        "one": {"missing": "pip install one"},
        "two": {"failed": "ValueError: of another version"},
    }
