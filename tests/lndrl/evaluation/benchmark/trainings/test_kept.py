"""What is handed on of a training: read from its run, packed, read back."""

from __future__ import annotations

import dataclasses
import json
import lzma
from pathlib import Path

import pytest

from lndrl.config import load_config
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.trainings import (
    kept_trainings,
    read_training,
    training_of,
    write_training,
)
from tests.lndrl.evaluation.benchmark.trainings.trained import MACHINE, counts, digits, write_run


def test_of_a_run_is_known_what_a_reader_asks_for(tmp_path: Path) -> None:
    found = training_of(write_run(tmp_path / "one"), digits("best"))
    assert found is not None
    assert (found.run, found.policy, found.tested, found.seed) == ("one", digits("best"), 200, 7)
    assert (found.steps, found.seconds, found.program) == (500, 300.2, "0.3")
    assert found.machine == MACHINE  # once, however often the learner was started there
    assert found.config == load_config("lndrl", ["seed=7"]).content_hash()
    assert found.validated == counts(3)
    assert len(found.rows) == 5 and [row["steps"] for row in found.curve] == [0, 200, 400]


def test_the_tested_policy_may_be_the_newest(tmp_path: Path) -> None:
    found = training_of(write_run(tmp_path / "one"), digits("newest"))
    assert found is not None and found.tested == 500 and found.validated is None


def test_of_a_run_that_has_moved_on_nothing_is_known(tmp_path: Path) -> None:
    assert training_of(write_run(tmp_path / "one"), digits("another")) is None
    assert training_of(tmp_path / "none", digits("best")) is None


def test_a_run_on_two_machines_names_both(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "one")
    with (folder / "events.log").open("a") as log:
        log.write("2026-12-02 04:56:21 machine    NVIDIA\n2026-12-02 04:56:22 join    machine x\n")
    found = training_of(folder, digits("best"))
    assert found is not None and found.machine == f"{MACHINE}; then NVIDIA"
    # The log goes on in another file once it is large.
    (folder / "events.log").rename(folder / "events.log.1")
    assert training_of(folder, digits("best")) == found
    (folder / "events.log.1").unlink()
    found = training_of(folder, digits("best"))
    assert found is not None and found.machine == ""


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    found = training_of(write_run(tmp_path / "one"), digits("best"))
    assert found is not None
    path = write_training(tmp_path, found)
    assert read_training(path) == found and kept_trainings(tmp_path) == [found]
    content = path.read_bytes()
    assert write_training(tmp_path, found).read_bytes() == content
    # The curve is there, what only the trainer needs is not, and nobody's host is named.
    text = lzma.decompress(content).decode()
    assert '"arrived":0.25' in text and "kl" not in text and "evaluator" not in text


def test_two_policies_of_one_run_are_kept_side_by_side(tmp_path: Path) -> None:
    run = write_run(tmp_path / "one")
    found = [training_of(run, digits(name)) for name in ("best", "newest")]
    for each in found:
        assert each is not None
        write_training(tmp_path, each)
    assert {each.tested for each in kept_trainings(tmp_path)} == {200, 500}


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    found = training_of(write_run(tmp_path / "one"), digits("best"))
    assert found is not None
    path = write_training(tmp_path, found)
    whole = path.read_bytes()
    lines = lzma.decompress(whole).splitlines()
    other = json.dumps({"training": {"run": "one"}}).encode()
    for damage in (
        whole[:-5],
        b"",
        lzma.compress(b""),
        lzma.compress(lines[0]),
        lzma.compress(b"\n".join([other, *lines[1:]])),
        lzma.compress(b"\n".join([*lines, b"["])),
        lzma.compress(b"\n".join([*lines, b'{"update":1}'])),
        lzma.compress(lines[0].replace(b'"seconds":300.2', b'"seconds":"x"') + b"\n" + lines[1]),
        lzma.compress(b"\n".join([*lines, b"[" * 100_000])),
    ):
        path.write_bytes(damage)
        with pytest.raises(UserError, match=r"one-\w{8}-training.jsonl.xz: is damaged .* delete"):
            read_training(path)


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("metrics.jsonl", '{"update": 1, "steps": 100, "episodes": {}}', "KeyError: 'time'"),
        ("metrics.jsonl", '{"update": 1, "steps": 1, "episodes": {}, "time": {"elapsed": 1}}',
         "episodes.count is missing"),
        ("metrics.jsonl", "[" * 100_000, "RecursionError"),
        ("checkpoints/best/validation.json", '{"steps": "many"}', "ValueError"),
        ("checkpoints/best/validation.json", "{}", "KeyError: 'steps'"),
        ("run.json", "", "JSONDecodeError"),
    ],
)  # fmt: skip
def test_a_damaged_run_is_named(tmp_path: Path, name: str, text: str, why: str) -> None:
    folder = write_run(tmp_path / "one")
    (folder / name).write_text(text)
    with pytest.raises(UserError, match="one") as caught:
        training_of(folder, digits("best"))
    assert why in str(caught.value)


def test_the_rest_of_a_training_is_plain(tmp_path: Path) -> None:
    found = training_of(write_run(tmp_path / "one"), digits("best"))
    assert found is not None
    told = json.loads(json.dumps(found.to_dict()))
    assert told["validated"] == counts(3) and "rows" not in told
    assert set(told) == {f.name for f in dataclasses.fields(found)} - {"rows", "curve"} | {
        "validated"
    }
