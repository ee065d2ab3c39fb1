"""``lndrl scenarios`` lists, describes and draws."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from lndrl.cli.main import run
from lndrl.config import REPOSITORY_CONFIGS

NAMES = {"hybrid", "sparse", "corridor", "hall", "irregular", "random", "office"}


def test_all_are_listed(capsys) -> None:
    assert run(["scenarios"]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in NAMES)
    assert "33 × 20" in said and "18–22" in said


def test_the_list_as_json(capsys) -> None:
    assert run(["scenarios", "--json"]) == 0
    listed = {each["name"]: each for each in json.loads(capsys.readouterr().out)}
    assert set(listed) >= NAMES
    assert listed["corridor"]["pedestrians"] == [22, 22]
    assert listed["office"]["size"] == [30.0, 20.0]


def test_what_was_found_on_a_map_is_told_in_its_frame(capsys) -> None:
    assert run(["scenarios", "office", "--json"]) == 0
    office = json.loads(capsys.readouterr().out)
    assert office["origin"] == [-4.0, -2.0]
    assert len(office["robot"]) >= 6 and len(office["routes"]) >= 6
    corners = [task["start"][:2] for task in office["robot"]]
    assert min(x for x, _ in corners) < 0 and all(x >= -4 and y >= -2 for x, y in corners)


def test_one_is_drawn(tmp_path, capsys) -> None:
    file = tmp_path / "hall.png"
    assert run(["scenarios", "hall", "--out", str(file)]) == 0
    assert str(file) in capsys.readouterr().out
    assert file.stat().st_size < 150_000
    assert Image.open(file).size[0] > 600


def test_a_layout_is_drawn(tmp_path, capsys) -> None:
    file = tmp_path / "layout.png"
    assert run(["scenarios", "random", "--layout", "2", "--out", str(file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["layout"] == "random-2"
    assert file.exists()


def test_what_a_scan_tells_is_told_and_drawn(tmp_path, capsys) -> None:
    assert run(["scenarios", "sparse", "--localizability"]) == 0
    said = capsys.readouterr().out
    assert "in 90 % of them" in said and said.count("\n") == 1
    file = tmp_path / "sparse.png"
    assert run(["scenarios", "sparse", "--localizability", "--out", str(file), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["localizability"]
    assert told["deviation_10"] < told["deviation_50"] < told["deviation_90"]
    assert 0.1 < told["share_unknown"] < 0.3 and len(told["map_hash"]) == 12
    plain = tmp_path / "plain.png"
    assert run(["scenarios", "sparse", "--out", str(plain)]) == 0
    assert Image.open(file).size != Image.open(plain).size


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--localizability"], "--localizability: name the scenario, or use --draw FOLDER"),
        (["hybird"], "did you mean hybrid?"),
        (["--out", "x.png"], "name the scenario to draw, or use --draw FOLDER"),
        (["hall", "--out", "x.gif"], "must end in .png"),
        (["hall", "--out", "nowhere/x.png"], "folder nowhere does not exist"),
        (["hall", "--draw", "pictures"], "use --out FILE.png to draw hall"),
        (["hall", "--draw", "p", "--out", "x.png"], "give one of them"),
        (["away.yaml"], "away.yaml: no such file"),
        (["random", "--layout", "-1"], "layout"),
    ],
)
def test_wrong_calls_are_refused_with_a_sentence(
    arguments, sentence, capsys, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    assert run(["scenarios", *arguments]) == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1


def test_a_map_that_is_wrong_is_named(tmp_path, capsys) -> None:
    (tmp_path / "s.yaml").write_text("name: s\nkind: map\nmap: m.yaml\n")
    assert run(["scenarios", str(tmp_path / "s.yaml")]) == 2
    assert "m.yaml: no such file" in capsys.readouterr().err


def test_no_picture_is_drawn_over_the_image_of_a_map(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    office = REPOSITORY_CONFIGS / "maps" / "office"
    with Image.open(office.with_suffix(".png")) as image:
        image.save("building.png")
    Path("building.yaml").write_text(
        office.with_suffix(".yaml").read_text().replace("office.png", "building.png")
    )
    Path("other.yaml").write_text("a: [")  # is not asked to be whole
    drawn = Path("building.png").read_bytes()
    for command in (["scenarios", "building.yaml"], ["play", "straight"]):
        assert run([*command, "--out", "building.png"]) == 2
        said = capsys.readouterr().err
        assert "building.png: is the image of the map building.yaml; name another" in said
    assert Path("building.png").read_bytes() == drawn
    for _ in range(2):  # a picture of ours may be drawn again
        assert run(["scenarios", "building.yaml", "--out", "look.png"]) == 0


def test_the_file_of_a_map_is_taken_for_a_scenario(capsys) -> None:
    office = str(REPOSITORY_CONFIGS / "maps" / "office.yaml")
    assert run(["scenarios", office, "--json"]) == 0
    of_the_map = json.loads(capsys.readouterr().out)
    assert run(["scenarios", "office", "--json"]) == 0
    assert of_the_map["robot"] == json.loads(capsys.readouterr().out)["robot"]
