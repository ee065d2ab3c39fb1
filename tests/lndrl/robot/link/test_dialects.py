"""Keys, tokens, qualities and attachments, as robots write them."""

from __future__ import annotations

import struct

import pytest

from lndrl.errors import UserError
from lndrl.robot.link import LATCHED, RELIABLE, SENSOR, Endpoint, Quality, Topic, bridge, rmw
from lndrl.robot.link.dialect import Party
from lndrl.robot.messages import MessageStore, names

HASH = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"
SCAN = Topic("/robot1/scan", names.SCAN, SENSOR)
ME = Party("aac3178e146ba6f1fc6e6a4085e77f21", "drive")


def test_rmw_keys_name_domain_topic_type_and_hash() -> None:
    jazzy, humble = (rmw.RmwDialect(MessageStore(each), 3) for each in ("jazzy", "humble"))
    start = "3/robot1/scan/sensor_msgs::msg::dds_::LaserScan_"
    assert jazzy.publish_key(SCAN) == f"{start}/{HASH}"
    assert humble.publish_key(SCAN) == f"{start}/TypeHashNotSupported"
    assert jazzy.subscribe_key(SCAN) == f"{start}/*"
    assert jazzy.hash_in(f"{start}/{HASH}") == HASH


def test_rmw_tokens_are_those_of_a_node() -> None:
    dialect = rmw.RmwDialect(MessageStore("jazzy"))
    token = dialect.token("subscriber", SCAN, ME, 4)
    assert token == (
        f"@ros2_lv/0/{ME.session}/0/4/MS/%/%/drive/%robot1%scan/"
        f"sensor_msgs::msg::dds_::LaserScan_/{HASH}/2::,5:,:,:,,"
    )
    assert dialect.node_token(ME) == f"@ros2_lv/0/{ME.session}/0/0/NN/%/%/drive"
    assert dialect.read_token(token) == Endpoint(
        "subscriber", "/robot1/scan", names.SCAN, HASH, ME.session, "/drive"
    )
    newer = dialect.token("publisher", SCAN, ME, 1) + "/backends:shm"
    seen = dialect.read_token(newer)
    assert seen is not None and seen.kind == "publisher"
    assert dialect.read_token(dialect.node_token(ME) or "") is None
    assert rmw.RmwDialect(MessageStore("jazzy"), 7).read_token(token) is None, "another domain"


@pytest.mark.parametrize(
    ("quality", "in_rmw", "in_bridge"),
    [
        (RELIABLE, "::,10:,:,:,,", ":1:0:0,10"),
        (SENSOR, "2::,5:,:,:,,", ":0:0:0,5"),
        (LATCHED, ":1:,1:,:,:,,", ":1:1:0,1"),
        (Quality(depth=42), "::,:,:,:,,", ":1:0:0,42"),
    ],
)
def test_qualities(quality: Quality, in_rmw: str, in_bridge: str) -> None:
    assert rmw.quality_text(quality) == in_rmw
    assert bridge.quality_text(quality) == in_bridge


def test_rmw_attachments_count_and_name_their_publisher() -> None:
    dialect = rmw.RmwDialect(MessageStore("jazzy"))
    token = dialect.token("publisher", SCAN, ME, 1)
    data = dialect.attachment(token, 5, 1_700_000_000_000_000_001)
    assert data is not None and len(data) == 33
    assert struct.unpack_from("<qqB", data) == (5, 1_700_000_000_000_000_001, 16)
    assert data[17:] == rmw.gid_of(token)
    assert rmw.read_attachment(data) == (5, 1_700_000_000_000_000_001, rmw.gid_of(token))
    # XXH3-128 of nothing, by the reference implementation, the low half first.
    assert rmw.gid_of("").hex() == bytes.fromhex("99aa06d3014798d86001c324468d497f")[::-1].hex()
    for broken in (data[:-1], data[:16] + b"\x08" + data[17:]):
        with pytest.raises(ValueError, match="an attachment"):
            rmw.read_attachment(broken)


def test_the_attachment_is_what_zenoh_serializes() -> None:
    from zenoh import ext

    token = "@ros2_lv/0/1/0/1/MP/%/%/n/%t/T/H/::,10:,:,:,,"
    serialized = ext.z_serialize((ext.Int64(1), ext.Int64(2), rmw.gid_of(token)))
    dialect = rmw.RmwDialect(MessageStore("jazzy"))
    assert dialect.attachment(token, 1, 2) == serialized.to_bytes()


def test_bridge_keys_are_topics_and_tokens_name_types() -> None:
    dialect = bridge.BridgeDialect()
    assert dialect.publish_key(SCAN) == dialect.subscribe_key(SCAN) == "robot1/scan"
    token = dialect.token("publisher", SCAN, ME, 9)
    assert token == (f"@/{ME.session}/@ros2_lv/MP/robot1§scan/sensor_msgs§msg§LaserScan/:0:0:0,5")
    expected = Endpoint("publisher", "/robot1/scan", names.SCAN, "", ME.session, "")
    assert dialect.read_token(token) == expected
    before = f"@ros2_lv/{ME.session}/MP/robot1§scan/sensor_msgs§msg§LaserScan/:0:0:0,5"
    assert dialect.read_token(before) == expected
    assert dialect.read_token(f"@/{ME.session}/@ros2_lv") is None
    assert dialect.attachment(token, 1, 1) is None


def test_neither_reads_the_other_ones_tokens() -> None:
    one, other = rmw.RmwDialect(MessageStore("jazzy")), bridge.BridgeDialect()
    assert one.read_token(other.token("publisher", SCAN, ME, 1)) is None
    assert other.read_token(one.token("publisher", SCAN, ME, 1)) is None


@pytest.mark.parametrize("name", ["scan", "/", "/a//b", "/a b", "/ä", "/1a", "/a/*"])
def test_names_that_are_no_topics(name: str) -> None:
    with pytest.raises(UserError, match="must be a full name like /scan"):
        Topic(name, names.SCAN)
