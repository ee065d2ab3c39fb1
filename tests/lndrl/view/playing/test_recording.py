"""Recordings for Rerun, read back by its own library."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from lndrl.errors import UserError
from lndrl.navigation import WorldSnapshot
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.view.playing import recording
from tests.lndrl.view.playing.walk import walk

Make = Callable[..., WorldSnapshot]
FRAMES = ("/map", "/map/odom", "/map/odom/base_link", "/map/odom/base_link/scan")


def test_a_recording_has_ros_frames_and_two_time_lines(world: Make, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    moments = walk(world, "lost")
    file = tmp_path / "walk.rrd"
    recording.save_recording(moments, str(file))
    reader = RrdReader(str(file))
    (entry,) = reader.recordings()
    assert entry.application_id == "lndrl"
    store = reader.store(store=entry)
    schema = store.schema()
    entities = set(schema.entity_paths())
    assert {*FRAMES} <= entities
    assert {"/map/base_link_true", "/map/particles", "/map/people", "/map/covariance"} <= entities
    assert {"/error/position", *(f"/reward/{part}" for part in REWARD_PARTS)} <= entities
    assert {"/policy/probabilities", "/policy/action", "/outcome"} <= entities
    found: dict[str, list[float]] = {"step": [], "sim_time": [], "error": []}
    for chunk in store.stream():
        if chunk.entity_path != "/error/position" or chunk.is_static:
            continue
        table = chunk.to_record_batch()
        found["step"] += table.column("step").to_pylist()
        nanoseconds = table.column("sim_time").cast("int64").to_pylist()
        found["sim_time"] += [each / 1e9 for each in nanoseconds]
        found["error"] += [value for (value,) in table.column("Scalars:scalars").to_pylist()]
    assert found["step"] == [0, 1, 2, 3]
    assert found["sim_time"] == pytest.approx([m.time for m in moments])
    assert found["error"] == pytest.approx([m.position_error for m in moments])


def test_odometry_on_top_of_the_correction_is_the_estimate(world: Make) -> None:
    for moment in walk(world, "arrived"):
        x, y, yaw = recording.map_to_odom(moment)
        ox, oy, turned = moment.pose_odometry
        cos, sin = math.cos(yaw), math.sin(yaw)
        composed = [x + cos * ox - sin * oy, y + sin * ox + cos * oy, yaw + turned]
        assert composed == pytest.approx(moment.pose_estimated.tolist())


@pytest.mark.parametrize(
    ("where", "sentence"),
    [("walk.gif", "must be a FILE.rrd"), ("/no/walk.rrd", "folder /no does not exist")],
)
def test_what_cannot_be_recorded_to_is_a_sentence(where: str, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        recording.check_target(where)


def test_nobody_at_an_address_is_a_sentence(world: Make) -> None:
    pytest.importorskip("rerun")
    with pytest.raises(UserError, match="--rerun nonsense://x"):
        recording.save_recording(walk(world, "arrived"), "nonsense://x")


def test_the_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(UserError, match=r'pip install "lndrl\[rerun\]"'):
        recording.needed()
