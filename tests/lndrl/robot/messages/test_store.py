"""Messages as bytes: ours, rosbags' and those of a second library are the same."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.robot.messages import DISTRIBUTIONS, BadMessageError, MessageStore, Scan, names, store
from tests.lndrl.robot.messages.samples import RECORDED, SAMPLES

dynamic = pytest.importorskip("mcap_ros2._dynamic")
EVERY = sorted(SAMPLES)


def same(a: Any, b: Any) -> bool:
    """Whether two pieces of plain data say the same, NaN and all."""
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(
            same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)
        )
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray | float):
        return bool(np.allclose(a, b, rtol=1e-6, atol=1e-7, equal_nan=True))
    return bool(a == b)


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_what_is_written_is_read(name: str, distribution: str) -> None:
    messages = MessageStore(distribution)
    assert same(messages.decode(name, messages.encode(name, SAMPLES[name])), SAMPLES[name])


@pytest.mark.parametrize("name", EVERY)
def test_a_second_library_reads_and_writes_the_same_bytes(name: str) -> None:
    messages = MessageStore("jazzy")
    text = messages.definition(name)
    data = messages.encode(name, SAMPLES[name])
    read = dynamic.generate_dynamic(name, text)[name](data)
    assert dynamic.serialize_dynamic(name, text)[name](read) == data
    assert data.hex() == RECORDED[name]


def test_a_second_library_finds_the_numbers_where_they_belong() -> None:
    messages = MessageStore("kilted")

    def read(name: str) -> Any:
        decoders = dynamic.generate_dynamic(name, messages.definition(name))
        return decoders[name](messages.encode(name, SAMPLES[name]))

    scan = read(names.SCAN)
    assert scan.header.stamp.sec == 1_700_000_001 and scan.header.stamp.nanosec == 200_000_003
    assert scan.header.frame_id == "laser" and scan.angle_max == pytest.approx(0.5)
    assert scan.ranges[0] == 1.0 and np.isnan(scan.ranges[2])
    pose = read(names.POSE_COVARIANCE)
    assert [pose.pose.covariance[k] for k in (0, 7, 35, 1, 11)] == [0.1, 0.2, 0.3, 0.01, 0.02]
    assert pose.pose.pose.orientation.z == pytest.approx(np.sin(1.5))
    command = read(names.TWIST)
    assert (command.linear.x, command.angular.z) == (0.4, -0.3)
    grid = read(names.MAP)
    assert (grid.info.width, grid.info.height, list(grid.data)) == (3, 2, [0, 100, -1, 0, 0, 50])
    person = read(names.PEOPLE).tracks[1]
    assert (person.track_id, person.twist.twist.linear.y) == (7, 0.2)
    upside_down = read(names.TF).transforms[1].transform.rotation
    assert (upside_down.x, upside_down.w) == (1.0, 0.0)


def test_hashes_are_those_of_the_distributions() -> None:
    # Seen in the keys of robots that run Jazzy.
    scan = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"
    assert MessageStore("jazzy").type_hash(names.SCAN) == scan
    assert MessageStore("humble").type_hash(names.SCAN) == "TypeHashNotSupported"
    for name in EVERY:  # so that a session needs not know which of the two it is
        assert MessageStore("jazzy").type_hash(name) == MessageStore("kilted").type_hash(name)


@pytest.mark.parametrize("name", EVERY)
def test_broken_bytes_are_a_sentence(name: str) -> None:
    messages = MessageStore("jazzy")
    data = messages.encode(name, SAMPLES[name])
    generator = np.random.default_rng(0)
    for cut in {0, 1, 4, len(data) // 2, len(data) - 1}:
        with pytest.raises(BadMessageError, match=name):
            messages.decode(name, data[:cut])
    for _ in range(50):  # whatever it is, nothing else is raised
        noise = bytearray(data)
        for place in generator.integers(4, len(data), 4):
            noise[place] = int(generator.integers(256))
        try:
            messages.decode(name, bytes(noise))
        except BadMessageError:
            continue


def test_arrays_of_another_kind_are_converted_not_reinterpreted() -> None:
    messages = MessageStore("jazzy")
    for ranges in (np.array([1, 2]), np.array([1, 2], ">f4"), np.arange(8.0)[1:5:2]):
        scan = Scan(0, "l", 0.0, 0.1, 0.1, 9.0, ranges.astype(ranges.dtype))
        read = messages.decode(names.SCAN, messages.encode(names.SCAN, scan))
        assert isinstance(read, Scan) and read.ranges.tolist() == [float(r) for r in ranges]


def test_unknown_velocities_of_people_are_zero() -> None:
    messages = MessageStore("jazzy")
    data = bytearray(messages.encode(names.PEOPLE, SAMPLES[names.PEOPLE]))
    at = len(data) - 36 * 8  # the covariance of the last twist
    data[at : at + 8] = np.float64(100_000.0).tobytes()
    read = messages.decode(names.PEOPLE, bytes(data))
    assert read.velocity.tolist() == [[0.5, 0.0], [0.0, 0.2]]  # type: ignore[union-attr]


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UserError, match="noetic is unknown; known: humble, jazzy, kilted"):
        MessageStore("noetic")
    monkeypatch.setitem(__import__("sys").modules, "rosbags.typesys", None)
    store._typestore.cache_clear()
    with pytest.raises(UserError, match=r'pip install "lndrl\[robot\]"'):
        MessageStore("jazzy")
