"""``lndrl doctor`` as a user meets it: table, JSON, exit codes, no secret anywhere."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lndrl import doctor
from lndrl.cli import main as command_line
from lndrl.doctor import Check
from lndrl.transport import free_endpoint
from lndrl.transport.security.certificates import create


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the diagnosis was asked, with one answer of each kind."""
    targets: list[Any] = []

    def diagnose(target: doctor.Target) -> Iterator[Check]:
        targets.append(target)
        yield Check("endpoint", "ok", "reads right")
        yield Check("actor: session", "skipped", "no [red]wonder[/red] " + "x" * 100)

    monkeypatch.setattr(doctor, "diagnose", diagnose)
    return targets


def test_a_table_for_people(asked: list[Any], capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.run(["doctor", "--connect", "tls/robot.lab:7447"]) == 0
    shown = capsys.readouterr().out
    assert "actor: session" in shown and "skipped" in shown
    # A sentence may hold anything that a stranger sent, and is shown as it is.
    assert "no [red]wonder[/red] " + "x" * 100 in shown
    assert asked[0].endpoint == "tls/robot.lab:7447" and asked[0].role is None


def test_failures_are_exit_code_one_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    endpoint = free_endpoint()
    assert command_line.run(["doctor", "--connect", endpoint, "--json"]) == 1
    shown = json.loads(capsys.readouterr().out)
    assert shown["ok"] is False
    assert [check["state"] for check in shown["checks"]] == ["ok", "ok", "failed", "skipped"]
    assert set(shown["checks"][0]) == {"name", "state", "text"}
    assert command_line.run(["doctor", "--connect", endpoint]) == 1
    assert "nobody listens" in capsys.readouterr().out
    assert command_line.run(["doctor", "--connect", "nonsense"]) == 1
    assert "write tcp/HOST:PORT" in capsys.readouterr().out


def test_every_role_of_the_folder_is_tried(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    create(tmp_path, [])
    (tmp_path / "learner.pem").unlink()
    given = ["doctor", "--connect", free_endpoint(), "--certs", str(tmp_path), "--json"]
    assert command_line.run(given) == 1
    names = {check["name"] for check in json.loads(capsys.readouterr().out)["checks"]}
    assert {"actor: certificates", "dashboard: certificates"} < names
    assert not any(name.startswith("learner") for name in names)


def test_the_password_comes_from_a_file_or_the_environment(
    asked: list[Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = tmp_path / "password"
    file.write_text("gehe1m\nmore\n")
    given = ["doctor", "--user", "actor-1", "--namespace", "lab", "--role", "actor"]
    assert command_line.run([*given, "--password-file", str(file)]) == 0
    monkeypatch.setenv("LNDRL_PASSWORD", "gehe1m")
    assert command_line.run(given) == 0
    assert [target.password for target in asked] == ["gehe1m", "gehe1m"]
    assert (asked[0].user, asked[0].namespace, asked[0].role) == ("actor-1", "lab", "actor")
    shown = capsys.readouterr()
    assert "gehe1m" not in shown.out + shown.err + repr(asked)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (["--role", "robot"], "--role robot: unknown"),
        (["--user", "actor"], "needs --password-file FILE or the variable LNDRL_PASSWORD"),
        (["--password-file", "x"], "goes with --user"),
        (["--user", "actor", "--password-file", "/no/such/file"], "cannot be read (No such file"),
        (["--user", "actor", "--password-file", "EMPTY"], "first line must be the password"),
        (["--user", "actor", "--password-file", "BINARY"], "is not text"),
    ],
)
def test_mistakes_are_sentences(
    given: list[str],
    sentence: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("LNDRL_PASSWORD", raising=False)
    (tmp_path / "EMPTY").write_text("\n")
    (tmp_path / "BINARY").write_bytes(b"\xff\xfe\xff")
    given = [str(tmp_path / one) if one.isupper() else one for one in given]
    assert command_line.run(["doctor", *given]) == 2
    error = capsys.readouterr().err
    assert sentence in error and len(error.splitlines()) == 1


@pytest.mark.parametrize("name", ["certs", "doctor"])
def test_help_needs_no_cryptography(name: str) -> None:
    import subprocess

    code = (
        "import sys\nfrom lndrl.cli.main import run\n"
        f"run(['{name}', '--help'])\nsys.exit('cryptography' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL).returncode == 0
