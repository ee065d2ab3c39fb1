"""``lndrl certs`` as a user meets it."""

from __future__ import annotations

from pathlib import Path

import pytest

from lndrl.cli import main as command_line
from lndrl.transport.security.certificates import host_names, load_certificate


def test_it_says_what_goes_where(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "certs"
    given = ["certs", "--out", str(out), "--host", "robot.lab", "10.1.2.3", "--days", "30"]
    assert command_line.run(given) == 0
    shown = capsys.readouterr().out
    assert "ca.pem learner.pem learner.key" in shown and "to the learner's machine" in shown
    assert "ca.pem actor.pem actor.key" in shown and "to every actor machine" in shown
    assert "ca.pem dashboard.pem dashboard.key" in shown
    assert "robot.lab, localhost, 10.1.2.3" in shown
    assert "ca.key stays here" in shown
    assert {"robot.lab", "10.1.2.3"} < set(host_names(load_certificate(out / "learner.pem")))


def test_a_second_time_is_a_sentence_and_renewing_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["certs", "--out", str(tmp_path)]
    assert command_line.run(out) == 0
    before = (tmp_path / "actor.pem").read_bytes()
    capsys.readouterr()
    assert command_line.run(out) == 2
    refused = capsys.readouterr().err
    assert refused.startswith(f"lndrl: {tmp_path} already holds ca.pem") and "--renew" in refused
    assert (tmp_path / "actor.pem").read_bytes() == before
    assert command_line.run([*out, "--renew", "actor", "dashboard"]) == 0
    shown = capsys.readouterr().out
    assert (tmp_path / "actor.pem").read_bytes() != before
    assert "actor.key" in shown and "dashboard.key" in shown and "learner.key" not in shown


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (["--host", "tcp/robot:7447"], "neither a host name nor an address"),
        (["--renew", "robot"], "role 'robot' is unknown"),
        (["--renew", "actor"], "holds no ca.pem"),
        (["--renew", "actor", "--host", "a"], "add --renew learner"),
        (["--days", "0"], "--days"),
    ],
)
def test_mistakes_are_sentences(
    more: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line.run(["certs", "--out", str(tmp_path / "x"), *more]) == 2
    error = capsys.readouterr().err
    assert sentence in error and len(error.splitlines()) == 1
    assert not (tmp_path / "x").exists()


def test_a_folder_that_is_a_file_is_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert command_line.run(["certs", "--out", str(tmp_path / "file")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_several_values_belong_to_certs_only() -> None:
    spread = command_line._spread_lists
    assert list(spread(["certs", "--host", "a", "b", "--renew", "x", "y", "--days", "3"])) == [
        "certs", "--host", "a", "--host", "b", "--renew", "x", "--renew", "y", "--days", "3"
    ]  # fmt: skip
    other = ["play", "--host", "a", "b"]
    assert list(spread(other)) == other
