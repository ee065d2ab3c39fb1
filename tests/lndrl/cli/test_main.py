"""The command line as a user meets it: help at once, sentences for mistakes, exit codes."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import pytest
from rich.text import Text

from lndrl.cli import main as command_line
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import this_program

ROOT = Path(command_line.__file__).resolve().parents[2]
HEAVY = (
    "torch",
    "numba",
    "numpy",
    "zenoh",
    "matplotlib",
    "pymunk",
    "scipy",
    "gymnasium",
    "PIL",
    "pydantic",
)


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


@pytest.mark.parametrize("name", command_line.SUMMARIES)
def test_no_help_text_is_taken_for_markup(name: str) -> None:
    """Rich drops what stands in square brackets, a default that is told in words, say."""

    def texts(command: Any) -> Iterator[str]:
        yield command.help or ""
        for parameter in command.params:
            yield getattr(parameter, "help", None) or ""
        for inner in getattr(command, "commands", {}).values():
            yield from texts(inner)

    for text in texts(command_line.load_command(name)):
        assert Text.from_markup(text).plain == text


def test_no_arguments_show_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.run([]) == 0
    assert "Usage: lndrl" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "needed"),
    [
        (["--help"], {}),
        (["--version"], {}),
        (["version"], {"pydantic"}),  # typer asks for it where a command has options
        (["train", "--help"], {"pydantic"}),
        (["config", "show", "lndrl"], {"pydantic"}),
        (["config", "explain", "ppo.epochs"], {"pydantic"}),
        (["scenarios"], {"pydantic", "numpy", "PIL"}),  # one of them is a map
    ],
)
def test_light_commands_import_nothing_heavy(arguments: list[str], needed: set[str]) -> None:
    code = (
        "import sys\nfrom lndrl.cli.main import run\n"
        f"assert run({arguments!r}) == 0\n"
        f"found = set(sys.modules) & set({HEAVY!r}) - set({[*needed]!r})\nassert not found, found"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


NAMESAKES = ("learner", "actors", "typer", "rich", "pydantic", "random", "queue", "pickle")


@pytest.fixture
def own_modules(tmp_path: Path) -> Path:
    """A folder with modules of the user's own, named like ours and like some that we use."""
    for name in NAMESAKES:
        (tmp_path / f"{name}.py").write_text("raise SystemExit(f'{__file__} was imported')\n")
    return tmp_path


def test_a_users_modules_do_not_stand_in_for_ours(own_modules: Path) -> None:
    command = [sys.executable, "-m", "lndrl", "config", "show", "lndrl"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=own_modules, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "scenario: hybrid" in done.stdout


def test_nor_in_processes_that_are_started_from_ours(own_modules: Path) -> None:
    # A console script, whose folder is where Python looks first, and not the working folder.
    script = own_modules / "bin" / "lndrl"
    script.parent.mkdir()
    script.write_text(
        "import subprocess, sys, types\n"
        "from lndrl.cli import main\n"
        "look = 'import importlib.util as u; print(u.find_spec(\"learner\").origin)'\n"
        "def version() -> None:\n"
        "    import multiprocessing as m\n"
        "    context = m.get_context('spawn')\n"
        "    process = context.Process(target=print, args=('spawned',))\n"
        "    process.start(); process.join(); assert process.exitcode == 0\n"
        "    subprocess.run([sys.executable, '-c', look], check=True)\n"
        "if __name__ == '__main__':\n"
        "    sys.modules['lndrl.cli.version'] = types.SimpleNamespace(version=version)\n"
        "    main.main()\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        [sys.executable, str(script), "version"],
        cwd=own_modules,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["spawned", str(ROOT / "learner/__init__.py")]


def test_programs_of_ours_are_started_with_the_safe_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/else/where")
    environment = this_program()
    assert environment["PYTHONSAFEPATH"] == "1"
    assert environment["PYTHONPATH"] == f"{ROOT}{os.pathsep}/else/where"


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
        (["evalute"], "lndrl: No such command 'evalute'. Did you mean 'evaluate', 'evaluator'?"),
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


def test_nowhere_to_keep_kernels_is_one_line(
    fake_version, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("numba.core.caching.CompileResultCacheImpl._locator_classes", [])
    with pytest.raises(RuntimeError) as numbas_own:
        numba.njit(cache=True)(lambda x: x)
    fake_version(numbas_own.value)
    assert command_line.run(["version"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "let NUMBA_CACHE_DIR or TMPDIR name one that can" in error


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


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGHUP, 129)]
)
def test_signals_end_a_process_without_a_traceback(number: int, code: int) -> None:
    waiting = (
        "import sys, time, types\n"
        "from lndrl.cli import main\n"
        "def version() -> None:\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(600)\n"
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
    _, error = process.communicate(timeout=120)
    assert process.returncode == code
    assert "Traceback" not in error


@pytest.mark.parametrize("group", ["config", "ship"])
def test_a_group_without_a_command_shows_its_help_and_nothing_else(group: str, capsys) -> None:
    assert command_line.run([group]) == 2
    out, err = capsys.readouterr()
    assert "Commands" in out + err and f"lndrl {group}:" not in err
