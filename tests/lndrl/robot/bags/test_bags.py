"""Recordings: written as others read them, and driven through once more."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.robot.bags import Bag, Replay, replay
from lndrl.robot.driving.assembly import DriveOptions, make_driver
from lndrl.robot.link import Topic
from lndrl.robot.messages import MessageStore, StampedPose, names
from lndrl.robot.recording import Recorder
from lndrl.robot.topics import Topics
from tests.lndrl.robot.rig import Rig

TOPICS = Topics()


def record(path: Path, rig: Rig, ticks: int, silent: range = range(0)) -> Recorder:
    """What a drive would record; ``silent`` are ticks of which the scan is missing."""
    store = MessageStore()
    recorder = Recorder(path, store)

    def write(purpose: str, content: Any) -> None:
        topic = TOPICS.topic(purpose)
        recorder.write(topic, store.encode(topic.type, content), rig.stamp)

    body = rig.body
    for purpose, content in (
        ("tf_static", body.mounting(rig.stamp)), ("map", body.map(rig.stamp)),
        ("initial_pose", body.initial_pose(rig.stamp)), ("goal", body.goal_pose(rig.stamp)),
    ):  # fmt: skip
        write(purpose, content)
    rig.begin()
    for k in range(ticks):
        before = len(rig.sent)

        def noted(purpose: str, content: Any, k: int = k) -> Any:
            if purpose == "scan" and k in silent:
                return None
            write(purpose, content)
            return content

        truth = StampedPose(rig.stamp, "map", body.pose_true.copy())
        recorder.write(Topic("/truth", names.POSE), store.encode(names.POSE, truth), rig.stamp)
        rig.tick(1, noted)
        for purpose, content in rig.sent[before:]:
            write(purpose, content)
    recorder.close()
    return recorder


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("bag") / "drive.mcap"
    recorder = record(path, Rig(), 60, range(30, 40))
    assert recorder.messages > 300 and not recorder.failed
    return path


def played(path: Path, reference: str | None = None, **options: Any) -> Replay:
    chosen = DriveOptions(**options)
    rig = Rig(chosen)
    with Bag(path, TOPICS, reference) as opened:
        return replay(opened, lambda send: make_driver(rig.pilot, chosen, send))


def test_a_second_library_reads_what_was_recorded(bag: Path) -> None:
    decoder = pytest.importorskip("mcap_ros2.decoder")
    from mcap.reader import make_reader

    with bag.open("rb") as file:
        reader = make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert reader.get_header().profile == "ros2"
        channels = {each.topic: each for each in summary.channels.values()}
        assert {"/scan", "/cmd_vel", "/lndrl/pose", "/lndrl/status"} <= set(channels)
        assert "transient_local" in channels["/map"].metadata["offered_qos_profiles"]
        scans = [each.decoded_message for each in reader.iter_decoded_messages(["/scan"])]
    assert len(scans) == 50 and scans[0].header.frame_id == "base_scan"
    assert len(scans[0].ranges) == 720


def test_a_replay_says_where_the_belief_went(bag: Path) -> None:
    result = played(bag, "/truth")
    summary = result.summary()
    assert summary["scans"] == summary["beliefs"] == 50
    assert summary["reference"] == "/truth" and summary["off_mean"] < 0.3
    assert summary["decisions"] > 5 and summary["seconds"] == pytest.approx(5.9, abs=0.2)
    assert 0.4 < summary["standing"]["scan_stale"] < 1.2, "while the scan was missing"
    assert "s old" in result.words["scan_stale"]
    assert summary["same_commands"] > 0.8, "the same planner over the same scans"
    assert result.map is not None and len(result.reference) == 60
    assert np.isfinite(result.column("off")).all()


def test_a_wrong_filter_is_found_out_by_its_own_recording(bag: Path) -> None:
    off = played(bag, "/truth", pose=(7.0, 3.0, 0.0)).summary()
    # The pose of the bag comes later and is believed; so does the map.
    assert off["off_end"] is not None
    beside = played(bag)
    assert beside.reference_topic == "/lndrl/pose" and beside.summary()["off_mean"] < 0.2


def test_rosbags_makes_folders_that_are_read(bag: Path, tmp_path: Path) -> None:
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    folder = tmp_path / "folder"
    with (
        Reader(bag) as reader,
        Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer,
    ):
        chosen = [each for each in reader.connections if "spencer" not in each.msgtype]
        made = {
            each.id: writer.add_connection(each.topic, each.msgtype, typestore=store)
            for each in chosen
        }
        for connection, stamp, data in reader.messages(chosen):
            writer.write(made[connection.id], stamp, data)
    assert played(folder).summary()["beliefs"] == 50
    (file,) = folder.glob("*.db3")
    assert played(file).summary()["beliefs"] == 50


def test_bags_that_are_none(bag: Path, tmp_path: Path) -> None:
    for name, data in (("empty.mcap", b""), ("text.mcap", b"hello" * 9), ("odd.txt", b"x")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(UserError, match="is no bag of ROS 2 that can be read"):
            Bag(tmp_path / name, TOPICS)
    with pytest.raises(UserError, match="is no bag"):
        Bag(tmp_path / "missing.mcap", TOPICS)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(bag.read_bytes()[:-4000])
    with pytest.raises(UserError, match=r"is no bag of|cannot be read to its end"):
        played(cut)
    with pytest.raises(UserError, match=r"has no /lidar; say --topic scan=/NAME. It has /cmd_vel"):
        Bag(bag, TOPICS.renamed({"scan": "/lidar"}))
    with pytest.raises(UserError, match="/scan has the type sensor_msgs/msg/LaserScan, not nav"):
        Bag(bag, TOPICS.renamed({"scan": "/odom", "odometry": "/scan"}))
    with pytest.raises(UserError, match="--reference /map must be a topic of"):
        Bag(bag, TOPICS, "/map")


def test_recordings_that_cannot_be(tmp_path: Path) -> None:
    store = MessageStore()
    (tmp_path / "there.mcap").write_bytes(b"")
    for name, words in (
        ("drive.bag", "must end in .mcap"), ("there.mcap", "exists already"),
        ("no/folder.mcap", "cannot be written"),
    ):  # fmt: skip
        with pytest.raises(UserError, match=words):
            Recorder(tmp_path / name, store)
