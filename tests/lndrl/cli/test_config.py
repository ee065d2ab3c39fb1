"""``lndrl config``: what a user is shown, compared and told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from lndrl.cli.main import run
from lndrl.config import REPOSITORY_CONFIGS, keys, load_config, shipped


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What ``lndrl config`` prints with ``arguments``."""
    assert run(["config", *arguments]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


def test_all_names_are_listed_by_kind(capsys: pytest.CaptureFixture[str]) -> None:
    shown = said(capsys, "show").splitlines()
    assert [line for line in shown if not line.startswith(" ")][:3] == [
        "configuration:",
        "scenario:",
        "sweep:",
    ]
    listed = {line.split()[0]: line for line in shown if line.startswith(" ")}
    assert {"lndrl", "paper", "hybrid", "ppo", "benchmark", "calibration"} <= set(listed)
    assert "open hall, people in all directions" in listed["hall"]
    assert listed["lndrl"].endswith("What learns best here")


@pytest.mark.parametrize("name", shipped("configuration"))
def test_what_is_shown_is_the_whole_configuration(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = said(capsys, "show", name)
    Path("mine.yaml").write_text(shown)
    assert load_config("mine.yaml") == load_config(name)
    assert yaml.safe_load(shown)["scenario"] == load_config(name).scenario.name
    assert str(REPOSITORY_CONFIGS / "schemas/configuration.json") in shown.splitlines()[0]
    assert "  map_channels: [64, 128, 256]" in shown


def test_settings_are_shown_and_a_changed_scenario_in_full(
    capsys: pytest.CaptureFixture[str],
) -> None:
    settings = ["ppo.epochs=7", "scenario.pedestrians.count=[3, 4]"]
    shown = said(capsys, "show", "lndrl", *(part for s in settings for part in ("--set", s)))
    data = yaml.safe_load(shown)
    assert data["ppo"]["epochs"] == 7
    assert data["scenario"]["pedestrians"]["count"] == [3, 4]
    Path("mine.yaml").write_text(shown)
    assert load_config("mine.yaml") == load_config("lndrl", settings)


@pytest.mark.parametrize("name", ["hall", "ppo", "benchmark", "calibration"])
def test_other_kinds_are_shown_as_they_are_written(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (path,) = REPOSITORY_CONFIGS.rglob(f"{name}.yaml")
    assert said(capsys, "show", name) == path.read_text()


def test_a_key_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    shown = said(capsys, "explain", "ppo.epochs")
    assert shown.splitlines()[:3] == [
        "ppo.epochs",
        f"    {keys()['ppo.epochs'].description}",
        "    whole number, at least 1; default 4",
    ]
    assert "lndrl 2" in shown and "paper 10" in shown
    assert shown.splitlines()[-2].startswith("GROUP: ")


def test_a_section_is_explained_with_all_that_it_holds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    shown = said(capsys, "explain", "localization")
    for name in keys():
        assert (f"\n{name}\n" in f"\n{shown}") == name.startswith("localization")
    listed = json.loads(said(capsys, "explain", "--json"))
    assert [each["name"] for each in listed] == list(keys())


def test_differences_are_listed_whatever_is_left_to_defaults(
    capsys: pytest.CaptureFixture[str],
) -> None:
    different = json.loads(said(capsys, "diff", "table-lndrl", "no_variance", "--json"))
    assert different == {"network.variances": [True, False]}
    shown = said(capsys, "diff", "lndrl", "paper")
    assert "ppo.epochs" in shown and "transport.upload_window" in shown
    assert "ppo.clip" not in shown
    Path("mine.yaml").write_text("base: lndrl\nppo: {epochs: 2}\n")
    assert "say the same" in said(capsys, "diff", "lndrl", "mine.yaml")


def test_schemas_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    for kind in ("configuration", "scenario", "sweep", "bench", "calibration", "robot", "metrics"):
        text = (REPOSITORY_CONFIGS / f"schemas/{kind}.json").read_text()
        assert said(capsys, "schema", kind) == text
    assert said(capsys, "schema").startswith('{\n  "$schema"')


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["show", "lndlr"], "configuration 'lndlr' is unknown; did you mean lndrl?"),
        (["show", "lndrl", "--set", "ppo.epoch=3"], "unknown key ppo.epoch; did you mean epochs?"),
        (["diff", "lndrl", "none.yaml"], "none.yaml: no such file; known by name: "),
        (["explain", "ppo.epoch"], "key ppo.epoch is unknown; did you mean ppo.epochs"),
        (["schema", "map"], "kind 'map' is unknown; known: configuration, scenario"),
        (["shwo"], "No such command 'shwo'"),
    ],
)
def test_mistakes_are_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["config", *arguments]) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err and captured.err.count("\n") == 1
    assert captured.out == ""
