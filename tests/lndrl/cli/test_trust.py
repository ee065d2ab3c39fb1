"""Every command that imports parts of one's own asks whether it may, and hands that on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lndrl import extensions
from lndrl.cli.main import load_command, run
from lndrl.cli.options import part_settings, trust
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import this_program, trust_options
from lndrl.extensions import PARTS_FOLDER

COMMANDS = (
    "actor", "learner", "train", "train-all", "sweep", "evaluate", "play", "benchmark",
    "calibrate", "scenarios", "localization", "lost",
)  # fmt: skip


@pytest.fixture(autouse=True)
def nothing_trusted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(extensions, "_trusted", {})
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_command_can_be_told_whom_to_trust(name: str) -> None:
    options = {option for p in load_command(name).params for option in p.opts}
    assert "--trust-modules" in options


@pytest.mark.parametrize("name", ["trajectories", "activations", "worst"])
def test_every_figure_can_be_told_whom_to_trust(name: str) -> None:
    command = load_command("figures").commands[name]
    assert "--trust-modules" in {option for p in command.params for option in p.opts}


def test_a_wrong_prefix_is_refused(capsys) -> None:
    assert run(["evaluate", "straight", "--trust-modules", "my-package"]) == 2
    assert "'my-package' is no module to trust" in capsys.readouterr().err


def test_trusted_modules_are_found_last_in_the_working_folder(tmp_path: Path) -> None:
    trust(None)
    assert str(tmp_path) not in sys.path and trust_options() == []
    assert PARTS_FOLDER not in this_program()
    trust(["mine", "other.parts"])
    assert sys.path[-1] == str(tmp_path)
    assert extensions.trusted_modules() == ("mine", "other.parts")


def test_runs_of_a_sweep_find_the_same_modules_and_no_others(tmp_path: Path) -> None:
    for name in ("mine", "colorsys", "sitecustomize"):
        (tmp_path / f"{name}.py").write_text(f"print({name!r})\n")
    folder = tmp_path / "sweep"  # where a run is started; what lies there is nobody's part
    folder.mkdir()
    (folder / "mine.py").write_text("print('another')\n")
    trust(["mine"])
    assert trust_options() == ["--trust-modules", "mine"]
    code = "from lndrl.cli.options import trust; trust(['mine']); import colorsys, mine"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=this_program(), capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("mine\n", "")


def test_settings_on_the_command_line() -> None:
    assert part_settings(["speed=0.3", "near=[1, 2]"], "--planner-set") == {
        "speed": 0.3,
        "near": [1, 2],
    }
    for text in ("speed", "=3", "a b=3", "a=[1"):
        with pytest.raises(UserError, match="--planner-set"):
            part_settings([text], "--planner-set")


def test_settings_need_a_planner_of_ones_own(capsys) -> None:
    assert run(["evaluate", "straight", "--planner-set", "speed=1"]) == 2
    assert "goes with a planner of your own" in capsys.readouterr().err
