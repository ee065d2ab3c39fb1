"""The end of help pages, exit codes, and the line that says what may come next."""

from __future__ import annotations

import ast
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lndrl import extensions
from lndrl.cli import main as command_line
from lndrl.cli.help import EXAMPLES, EXIT_CODES, say_next
from lndrl.cli.help.examples import epilog
from lndrl.machine.signals import STOP_SIGNALS

CLI = Path(command_line.__file__).parent


def paths() -> Iterator[str]:
    def below(words: str, command: Any) -> Iterator[str]:
        yield words
        for name, inner in getattr(command, "commands", {}).items():
            yield from below(f"{words} {name}", inner)

    for name in command_line.SUMMARIES:
        yield from below(name, command_line.load_command(name))


def test_every_command_has_one_to_three_examples_of_its_own() -> None:
    assert set(EXAMPLES) == {"", *paths()}
    for name, examples in EXAMPLES.items():
        assert 1 <= len(examples) <= 3, name
        assert all(f"{each.line} ".startswith(name) for each in examples), name


@pytest.mark.parametrize("name", ["train", "runs rm", "config", "certs", "figures behaviour"])
def test_a_help_page_ends_with_them(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert command_line.run([*name.split(), "--help"]) == 0
    end = capsys.readouterr().out.rpartition("Examples:")[2]
    assert [line.strip() for line in end.splitlines() if line.strip()] == [
        line.strip() for line in epilog(name).splitlines()[1:]
    ]


def test_they_fit_in_80_columns() -> None:
    assert max(len(line) for name in EXAMPLES for line in epilog(name).splitlines()) <= 78


def test_the_programs_own_help_has_the_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.run(["--help"]) == 0
    said = capsys.readouterr().out
    for code, meaning in EXIT_CODES.items():
        assert re.search(rf"^ +{code}  {re.escape(meaning)} *$", said, re.MULTILINE), code


def test_the_codes_are_those_that_are_used() -> None:
    written = {
        node.args[0].value
        for path in CLI.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr == "Exit"
        and node.args
        and isinstance(node.args[0], ast.Constant)
    }
    assert written | {0, 2} == {code for code in EXIT_CODES if code < 128}
    assert {128 + number for number in STOP_SIGNALS} == {code for code in EXIT_CODES if code >= 128}


def test_commands_end_with_them(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert command_line.run(["version"]) == 0
    assert command_line.run(["ship", "weights", "nothing"]) == 2
    assert command_line.run(["versoin"]) == 2
    # Nobody listens there: what was checked is not as it should be.
    assert command_line.run(["doctor", "--connect", "tcp/127.0.0.1:1"]) == 1

    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("lndrl.cli.version.version", interrupted)
    assert command_line.run(["version"]) == 128 + signal.SIGINT


def test_what_comes_next_can_be_called(capsys: pytest.CaptureFixture[str]) -> None:
    say_next("lndrl", "lost", "runs/my run", "--seed", 3, then="why")
    say_next(then="open page.html")
    assert capsys.readouterr().out == (
        "next: lndrl lost 'runs/my run' --seed 3  # why\nnext: open page.html\n"
    )


@pytest.mark.parametrize(
    ("words", "following"),
    [
        ("config show", "next: lndrl config show lndrl  # all keys of one"),
        ("config explain ppo.epochs", "next: lndrl train --set ppo.epochs=4  # "),
        ("version", "next: lndrl version --json  # for a report of a bug"),
        ("scenarios", "next: lndrl scenarios hall --out hall.png  # a picture of one"),
        (
            "bench reward --seconds 0.02",
            "next: lndrl bench reward --seconds 0.02 --json  # all digits",
        ),
        ("bench laser --seconds 0.02", "next: lndrl bench laser --seconds 0.02 --peers  # beside"),
        ("certs --out certs --host here", "next: lndrl learner --listen tls/0.0.0.0:7447 --certs"),
    ],
)
def test_the_last_line_says_it(
    words: str,
    following: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(extensions, "_trusted", {})  # the bench of rewards trusts its own
    assert command_line.run(words.split()) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith(following)


def test_nothing_follows_json_or_what_is_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    for words in ("config explain ppo.epochs --json", "scenarios --json", "config show lndrl"):
        assert command_line.run(words.split()) == 0
        assert "next:" not in capsys.readouterr().out
