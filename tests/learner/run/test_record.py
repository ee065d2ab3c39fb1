"""metrics.jsonl and TensorBoard on disks that refuse."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest

from learner.run.record import EpisodeWindow, Recorder, quiet_tensorboard
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.navigation import REWARD_PARTS, EpisodeRecord


def row(update: int, **ppo: float) -> dict:
    groups = {"episodes": {"count": 1}, "reward_parts": {}, "lag": {"mean": 0.0}, "time": {}}
    return {"update": update, "steps": 32 * update, "ppo": {"kl": 0.1, **ppo}, **groups}


def updates(folder: Path) -> list[int]:
    return [row["update"] for row in read_metrics(folder / "metrics.jsonl")]


def test_resuming_cuts_what_came_after_the_checkpoint(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, 0)
    for n in range(1, 6):
        recorder.add(row(n))
    recorder.close()
    recorder = Recorder(tmp_path, 3)
    recorder.add(row(4))
    recorder.close()
    assert updates(tmp_path) == [1, 2, 3, 4]


@pytest.mark.parametrize("half", ['{"update": 3, "st', '{"update": 3, "steps": 96}', "\x00\x00"])
def test_resuming_copes_with_a_row_cut_short(tmp_path: Path, half: str) -> None:
    lines = [json.dumps(row(n)) + "\n" for n in (1, 2)]
    (tmp_path / "metrics.jsonl").write_text("".join(lines) + half)
    recorder = Recorder(tmp_path, 2)
    recorder.add(row(3))
    recorder.close()
    assert updates(tmp_path) == [1, 2, 3]


def test_a_row_cut_short_in_the_middle_is_left_out(tmp_path: Path) -> None:
    """As an older program left it where the disk was full for a while."""
    good = [json.dumps(row(n)) + "\n" for n in (1, 3)]
    (tmp_path / "metrics.jsonl").write_text(good[0] + '{"update": 2, "st{"update": 2}\n' + good[1])
    assert updates(tmp_path) == [1, 3]
    Recorder(tmp_path, 3).close()
    assert updates(tmp_path) == [1, 3]


def test_own_reward_terms_have_columns_from_the_first_row_on(tmp_path: Path) -> None:
    window = EpisodeWindow(0, ("keep_right",))
    assert window.reward_parts() == dict.fromkeys((*REWARD_PARTS, "keep_right"))
    parts = {**dict.fromkeys(REWARD_PARTS, 0.0), "keep_right": -3.0}
    window.add([EpisodeRecord(0, 0, "lost", 1, 0.4, 0.1, 0.1, 0.1, 0.1, -3.0, parts)])
    assert window.reward_parts()["keep_right"] == -3.0
    recorder = Recorder(tmp_path, 0)
    recorder.add({**row(1), "reward_parts": window.reward_parts()})
    recorder.close()
    assert read_metrics(tmp_path / "metrics.jsonl")[0]["reward_parts"]["keep_right"] == -3.0


def test_numbers_that_are_none_become_null(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, 0)
    recorder.add(row(1, importance_max=float("inf"), kl=float("nan")))
    recorder.close()
    text = (tmp_path / "metrics.jsonl").read_text()
    assert json.loads(text, parse_constant=pytest.fail)["ppo"]["importance_max"] is None


def test_a_disk_that_refuses_is_said_once_and_stops_nothing(tmp_path: Path, monkeypatch) -> None:
    said = []
    recorder = Recorder(tmp_path, 0, lambda what, error: said.append((what, error is None)))

    def refuse(*_: object) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("learner.run.lines.os.write", refuse)
        patch.setattr("torch.utils.tensorboard.SummaryWriter.add_scalar", refuse)
        patch.setattr("tensorboard.summary.writer.event_file_writer.EventFileWriter.flush", refuse)
        for n in (1, 2, 3):
            recorder.add(row(n))
    monkeypatch.setattr("learner.run.lines._RETRY", 0.0)
    recorder.add(row(4))
    recorder.close()
    assert updates(tmp_path) == [1, 2, 3, 4]
    for what in ("metrics.jsonl", "tensorboard/"):
        assert [works for place, works in said if place == what] == [False, True]


def test_a_folder_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    said = []
    (tmp_path / "tensorboard").write_text("in the way")
    (tmp_path / "metrics.jsonl").mkdir()
    recorder = Recorder(tmp_path, 5, lambda what, error: said.append(what))
    recorder.add(row(6))
    recorder.close()
    assert set(said) == {"metrics.jsonl", "tensorboard/"}


def test_only_tensorboards_own_thread_is_quiet_about_the_disk(monkeypatch) -> None:
    told: list[threading.ExceptHookArgs] = []
    monkeypatch.setattr(threading, "excepthook", told.append)
    quiet_tensorboard()

    class Writer(threading.Thread):
        """As TensorBoard's."""

        def run(self) -> None:
            raise error

    for module, error, is_told in (
        ("tensorboard.summary", OSError("the disk is full"), False),
        ("tensorboard.summary", ValueError("a bug"), True),
        ("tensorboards", OSError("the disk is full"), True),
    ):
        Writer.__module__ = module
        thread = Writer()
        thread.start()
        thread.join()
        assert [what.exc_value for what in told] == [error] * is_told
        told.clear()
