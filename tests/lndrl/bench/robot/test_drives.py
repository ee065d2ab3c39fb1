"""The bench of drives: its figures are those of a real drive, its comparison pairs episodes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from lndrl.bench.robot import drives
from lndrl.robot.driving import Pilot
from lndrl.robot.driving.assembly import DriveOptions

ROOM = """
name: room
size: [9, 6]
pedestrians: {count: [0, 0]}
obstacles: [{circle: [6.5, 1.2, 0.3]}, {box: [1.0, 4.9, 2.2, 5.4]}]
robot: [{start: [1, 2, 2, 3], goal: [5, 2, 6, 3]}]
"""


@pytest.fixture
def pilot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Pilot:
    (tmp_path / "room.yaml").write_text(ROOM)
    monkeypatch.setattr(drives, "POLICY", "straight")
    monkeypatch.setattr(drives, "SCENARIO", str(tmp_path / "room.yaml"))
    source, config = drives._driven()
    return Pilot(source, config)


def test_a_rehearsal_is_judged_episode_by_episode(pilot: Pilot) -> None:
    ended: list[int] = []
    records = drives._rehearsed(pilot, 2, seed=0, advance=lambda: ended.append(1))
    assert len(ended) == 2
    assert [each["episode"] for each in records] == [0, 1]
    assert {each["outcome"] for each in records} <= {"arrived", "collided", "lost", "timeout"}
    assert all(each["time"] > 1.0 for each in records)


def test_the_comparison_pairs_the_same_episodes(
    pilot: Pilot, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ends = ["arrived"] * 70 + ["collided"] * 10 + ["timeout"] * 20
    driven = [{"episode": k, "outcome": end} for k, end in enumerate(ends)]
    other = ["arrived"] * 68 + ["timeout"] * 12 + ["arrived"] * 4 + ["lost"] * 16
    result = SimpleNamespace(records=[SimpleNamespace(outcome=end) for end in other])
    monkeypatch.setattr(drives, "make_pilot", lambda *_: pilot)
    monkeypatch.setattr(drives, "_rehearsed", lambda *_: driven[::-1])
    monkeypatch.setattr(drives, "evaluate", lambda *_, **__: result)
    found = drives.compare(100)
    arrived = found["arrived"]
    assert (arrived["driven"], arrived["evaluated"]) == (0.7, 0.72)
    assert arrived["difference"] == pytest.approx(-0.02)
    assert arrived["interval_low"] < -0.02 < arrived["interval_high"]
    assert arrived["interval_high"] - arrived["interval_low"] < 0.12, "paired, so narrow"
    assert found["collided"]["difference"] == pytest.approx(0.1)
    said = capsys.readouterr()
    assert not said.out and "driven: 100 episodes" in said.err and "evaluated: 100" in said.err


def test_it_is_the_shipped_policy_with_a_pose_that_is_heard_at_once() -> None:
    source, config = drives._driven()
    assert source.name == "shipped" and config.scenario.name == "hall"
    assert config.localization.delay == 0 and DriveOptions().preset is None
