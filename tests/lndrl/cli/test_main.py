"""The command line as a user meets it: help at once, sentences for mistakes, exit codes."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from lndrl.cli import main as command_line
from lndrl.errors import UserError

ROOT = Path(command_line.__file__).resolve().parents[2]
HEAVY = ("torch", "numba", "numpy", "zenoh", "matplotlib", "pymunk", "scipy", "gymnasium")


@pytest.fixture
def fake_version(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException | None], None]:
    """Replace what ``lndrl version`` does by raising something."""

    def install(error: BaseException | None) -> None:
        def version() -> None:
            """Nothing."""
            if error is not None:
                raise error

        module = SimpleNamespace(version=version)
        monkeypatch.setitem(sys.modules, "lndrl.cli.version", module)

    return install


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.run(["--help"]) == 0
    shown = capsys.readouterr().out
    for name, summary in command_line.SUMMARIES.items():
        assert name in shown
        assert (ROOT / command_line.module_of(name).replace(".", "/")).with_suffix(".py").is_file()
        assert summary.split()[0] in shown


@pytest.mark.parametrize("name", command_line.SUMMARIES)
def test_every_command_has_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.run([name, "--help"]) == 0
    assert f"Usage: lndrl {name}" in capsys.readouterr().out


def test_no_arguments_show_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.run([]) == 0
    assert "Usage: lndrl" in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["version"], ["train", "--help"]])
def test_light_commands_import_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys\nfrom lndrl.cli.main import run\n"
        f"assert run({arguments!r}) == 0\n"
        f"found = set(sys.modules) & set({HEAVY!r})\nassert not found, found"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_version_is_the_packages_own(capsys: pytest.CaptureFixture[str]) -> None:
    tree = ast.parse((ROOT / "lndrl" / "version.py").read_text())
    written = [ast.literal_eval(n.value) for n in tree.body if isinstance(n, ast.Assign)]
    assert command_line.run(["--version"]) == 0
    assert [capsys.readouterr().out.strip()] == written
    assert command_line.run(["version"]) == 0
    assert written[0] in capsys.readouterr().out


def test_version_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.run(["version", "--json"]) == 0
    shown = ast.literal_eval(capsys.readouterr().out)
    assert {"lndrl", "python", "torch", "eclipse-zenoh"} <= set(shown)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["evalute"], "lndrl: No such command 'evalute'. Did you mean 'evaluate'?"),
        (["--bogus"], "lndrl: No such option: --bogus"),
        (["train", "a.yaml", "--stepz", "3"], "lndrl train: No such option: --stepz"),
        (["train", "a.yaml", "--steps", "0"], "lndrl train: Invalid value for '--steps'"),
        (["train", "a.yaml", "--actors", "two"], "lndrl train: Invalid value for '--actors'"),
        (["train", "a.yaml", "b.yaml"], "lndrl train: Got unexpected extra argument"),
        (["actor"], "lndrl actor: Missing option '--connect'"),
    ],
)
def test_mistyped_command_lines(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line.run(arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(sentence)
    assert captured.err.count("\n") == 1
    assert captured.out == ""


def test_a_user_error_is_one_line(fake_version, capsys: pytest.CaptureFixture[str]) -> None:
    fake_version(UserError("a.yaml: ppo.epochs\n must be 1 or more"))
    assert command_line.run(["version"]) == 2
    assert capsys.readouterr().err == "lndrl: a.yaml: ppo.epochs must be 1 or more\n"


def test_ctrl_c_leaves_with_130(fake_version, capsys: pytest.CaptureFixture[str]) -> None:
    fake_version(KeyboardInterrupt())
    assert command_line.run(["version"]) == 130
    assert capsys.readouterr().err.strip() == ""


def test_a_defect_is_not_hidden(fake_version) -> None:
    fake_version(ZeroDivisionError("ours"))
    with pytest.raises(ZeroDivisionError):
        command_line.run(["version"])


@pytest.mark.parametrize(
    ("given", "spread"),
    [
        ("--set a=1 b.c=2 --steps 3", "--set a=1 --set b.c=2 --steps 3"),
        ("x.yaml --set a=1 --set b=2", "x.yaml --set a=1 --set b=2"),
        ("--set a=1 x.yaml b=2", "--set a=1 x.yaml b=2"),
        ("--run a=1 b=2", "--run a=1 b=2"),
    ],
)
def test_one_set_takes_several_values(given: str, spread: str) -> None:
    assert list(command_line._spread_settings(given.split())) == spread.split()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_signals_end_a_process_without_a_traceback(number: int, code: int) -> None:
    waiting = (
        "import sys, time, types\n"
        "from lndrl.cli import main\n"
        "def version() -> None:\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(60)\n"
        "sys.modules['lndrl.cli.version'] = types.SimpleNamespace(version=version)\n"
        "sys.argv = ['lndrl', 'version']\n"
        "main.main()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", waiting],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    os.kill(process.pid, number)
    _, error = process.communicate(timeout=20)
    assert process.returncode == code
    assert "Traceback" not in error
