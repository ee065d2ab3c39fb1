"""The command ``lndrl localization``: what it prints, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from lndrl.cli.main import run
from lndrl.config import LocalizationConfig
from lndrl.errors import UserError
from lndrl.evaluation.localization.settings import load_settings, scenarios_named
from lndrl.evaluation.localization.tables import BEGIN, END, write_document

ROOM = """
name: room
size: [7, 5]
obstacles: [{box: [3, 0.1, 3.4, 2]}]
pedestrians: {count: [1, 1], routes: [{start: [1, 4, 2, 4.5], goal: [5, 4, 6, 4.5]}]}
robot: [{start: [1, 1, 2, 3], goal: [4, 1, 5, 3]}]
"""
TRY = ["--seeds", "2", "--pedestrians", "0,2", "--updates", "60", "--workers", "0"]


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str, str]:
    """A scenario, few particles, and the same with much motion noise."""
    few = "min_particles: 100\nmax_particles: 200\n"
    contents = {
        "room.yaml": ROOM,
        "few.yaml": few,
        "wide.yaml": "localization:\n  odom_alpha3: 2.0\n  " + few.replace("\n", "\n  "),
    }
    for name, content in contents.items():
        (tmp_path / name).write_text(content)
    room, few, wide = (str(tmp_path / name) for name in contents)
    return room, few, wide


def test_json_alone_on_stdout(files: tuple[str, str, str], capsys) -> None:
    room, few, wide = files
    given = ["localization", "--scenarios", room, "--settings", f"{few},{wide}", *TRY, "--json"]
    assert run(given) == 0
    out, err = capsys.readouterr()
    data = json.loads(out)
    assert data["settings"]["wide"]["odom_alpha3"] == 2.0
    assert data["settings"]["few"]["max_particles"] == 200
    assert [(c["pedestrians"], c["setting"]) for c in data["cells"]] == [
        (0, "few"), (0, "wide"), (2, "few"), (2, "wide")]  # fmt: skip
    cell = data["cells"][0]
    assert cell["lost"]["count"] == 0 and 0.0 < cell["position_rmse"] < 0.3
    assert set(cell["recovered"]) == {"told", "carried", "global"}
    assert data["machine"]["cores"] >= 1
    assert "8 of 8 replays" in err


def test_tables_and_document(files: tuple[str, str, str], tmp_path: Path, capsys) -> None:
    room, few, _ = files
    out = tmp_path / "report.md"
    out.write_text(f"# Before\n\n{BEGIN}\nold figures\n{END}\n\nAfter.\n")
    assert run(["localization", "--scenarios", room, "--settings", few, *TRY,
                "--out", str(out)]) == 0  # fmt: skip
    printed = capsys.readouterr().out
    assert "lost drives" in printed and "carried 3 m" in printed
    text = out.read_text()
    assert text.startswith("# Before\n") and text.endswith("After.\n")
    assert "old figures" not in text and text.count("| room | 2 | few |") == 2
    assert "](report.png)" in text and "numba" in text
    with Image.open(tmp_path / "report.png") as image:
        assert image.width > 600


def test_a_new_document_can_be_written_again(tmp_path: Path) -> None:
    path = tmp_path / "new.md"
    write_document(path, "one")
    write_document(path, "two")
    assert path.read_text().count("two") == 1 and "one" not in path.read_text()
    foreign = tmp_path / "foreign.md"
    foreign.write_text("text of somebody")
    with pytest.raises(UserError, match="no place for the figures"):
        write_document(foreign, "one")
    assert foreign.read_text() == "text of somebody"


def test_the_paper_s_settings_are_the_defaults() -> None:
    assert load_settings("paper") == LocalizationConfig()
    assert load_settings("best").odom_model_type == "diff-corrected"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--scenarios", "hybird"], "did you mean hybrid?"),
        (["--scenarios", ","], "--scenarios"),
        (["--settings", "worst"], "--settings worst: unknown; known: paper"),
        (["--settings", "perfect"], "perfect has no errors"),
        (["--settings", "none.yaml"], "none.yaml: no such file"),
        (["--settings", "paper,paper"], "paper is named twice"),
        (["--seeds", "0"], "--seeds 0: must be 1 or more"),
        (["--pedestrians", "0,x"], "--pedestrians 0,x"),
        (["--pedestrians", "-1"], "--pedestrians -1"),
        (["--updates", "5"], "5 updates"),
        (["--workers", "-1"], "--workers -1"),
        (["--out", "report.txt"], "must end in .md"),
        (["--out", "/no/where.md"], "/no does not exist"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys) -> None:
    given = ["localization", "--settings", "paper", "--scenarios", "hybrid", *arguments]
    assert run(given) == 2
    out, err = capsys.readouterr()
    assert sentence in err and len(err.strip().splitlines()) == 1
    assert out == ""


def test_bad_keys_in_a_settings_file(tmp_path: Path, capsys) -> None:
    file = tmp_path / "odd.yaml"
    file.write_text("odom_alpha9: 1\n")
    assert run(["localization", "--settings", str(file), "--scenarios", "hybrid"]) == 2
    assert "odd.yaml: unknown key odom_alpha9" in capsys.readouterr().err
    file.write_text("kind: perfect\n")
    assert run(["localization", "--settings", str(file), "--scenarios", "hybrid"]) == 2
    assert "no errors to report" in capsys.readouterr().err
    file.write_text("update_ticks: [2, 3]\n")
    assert run(["localization", "--settings", str(file), "--scenarios", "hybrid"]) == 2
    assert "setting odd: update_ticks [2, 3] must end with 4" in capsys.readouterr().err


def test_a_mixture_is_told_to_name_its_places() -> None:
    with pytest.raises(UserError, match="school is several places; name those: hybrid, random"):
        scenarios_named(["hall", "school"])
