"""Configurations by name or path: one rule, whoever asks, from whatever folder."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from lndrl.config import (
    DEFAULTS,
    REPOSITORY_CONFIGS,
    Kind,
    find,
    load_config,
    load_scenario,
    shipped,
)
from lndrl.errors import UserError


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nothing of the program lies where the user works."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (
            "configuration",
            {
                "lndrl",
                "paper",
                "drl_laser",
                "drl_laser-trusting",
                "drl_laser_ped",
                "drl_laser_ped-alone",
                "drl_laser_ped-trusting",
                "no_reward",
                "no_reward-alone",
                "no_variance",
                "no_variance-alone",
                "reward_alone",
                "shipped-robot",
                "table-alone",
                "table-careful",
                "table-lndrl",
            },
        ),
        (
            "scenario",
            {
                *("hybrid", "sparse", "corridor", "hall", "irregular"),
                *("random", "crowd", "school", "office"),
            },
        ),
        ("sweep", {"ppo", "later", "smoke", "from-nothing", "from-example"}),
        ("bench", {"benchmark", "benchmark-robot", "benchmark-v1"}),
        ("calibration", {"calibration"}),
        ("robot", {"generic", "turtlebot2", "turtlebot3-burger", "turtlebot4"}),
    ],
)
def test_every_kind_is_found_by_name(kind: Kind, names: set[str]) -> None:
    assert set(shipped(kind)) == names
    for name in names:
        path = find(kind, name)
        assert path.is_file() and path.stem == name and path.is_relative_to(REPOSITORY_CONFIGS)


def test_every_file_that_is_shipped_has_a_kind() -> None:
    files = {path for path in REPOSITORY_CONFIGS.rglob("*.yaml") if path.parent.name != "maps"}
    kinds: tuple[Kind, ...] = get_args(Kind)
    found = [path for kind in kinds for path in shipped(kind).values()]
    assert sorted(found) == sorted(files)
    assert all(name in shipped(kind) for kind, name in DEFAULTS.items())


@pytest.mark.parametrize("name", shipped("configuration"))
def test_configurations_load_from_any_folder(name: str) -> None:
    assert load_config(name) == load_config(REPOSITORY_CONFIGS / f"{name}.yaml")


@pytest.mark.parametrize(
    ("kind", "named", "sentence"),
    [
        ("configuration", "lndlr", "configuration 'lndlr' is unknown; did you mean lndrl?"),
        ("configuration", "benchmark", "configuration 'benchmark' is unknown; known by name: "),
        ("configuration", "configs/lndrl.yaml", "no such file; did you mean lndrl? known by name:"),
        ("configuration", "mine.yaml", "mine.yaml: no such file; known by name: drl_laser, "),
        ("scenario", "hal", "scenario 'hal' is unknown; did you mean hall?"),
        ("sweep", "pp0", "sweep 'pp0' is unknown; did you mean ppo? known by name: from-"),
        ("bench", "bench", "bench 'bench' is unknown; did you mean benchmark?"),
        ("configuration", "folder.yaml", "folder.yaml: is a folder, not a YAML file"),
    ],
)
def test_a_wrong_name_lists_the_right_ones(kind: Kind, named: str, sentence: str) -> None:
    Path("folder.yaml").mkdir()
    with pytest.raises(UserError) as caught:
        find(kind, named)
    assert sentence in str(caught.value)


def test_names_go_before_files_of_that_name_and_paths_are_the_users_own() -> None:
    Path("lndrl").write_text("scenario: sparse\n")
    Path("lndrl.yaml").write_text("scenario: sparse\n")
    Path("plain").write_text("scenario: sparse\n")
    assert load_config("lndrl").scenario.name == "hybrid"
    for named in ("lndrl.yaml", "./lndrl", "plain"):
        assert load_config(named).scenario.name == "sparse"


def test_a_run_folder_stands_for_its_configuration() -> None:
    folder = Path("runs/first")
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text("scenario: hall\nseed: 7\n")
    assert load_config("runs/first").seed == 7


def test_a_copy_of_a_shipped_file_works_in_any_folder() -> None:
    folder = Path("mine")
    folder.mkdir()
    for name in ("drl_laser", "no_reward", "drl_laser_ped-alone"):
        source = (REPOSITORY_CONFIGS / f"{name}.yaml").read_text()
        assert re.search(r"^base: \S+\.yaml$", source, re.MULTILINE)
        (folder / "copy.yaml").write_text(source)
        assert load_config("mine/copy.yaml") == load_config(name)
    (folder / "own.yaml").write_text("base: lndrl\nseed: 5\n")
    assert load_config("mine/own.yaml").seed == 5


def test_a_base_beside_the_file_goes_before_the_shipped_one() -> None:
    folder = Path("mine")
    folder.mkdir()
    (folder / "lndrl.yaml").write_text("scenario: sparse\nseed: 9\n")
    (folder / "own.yaml").write_text("base: lndrl.yaml\n")
    assert load_config("mine/own.yaml").seed == 9
    (folder / "own.yaml").write_text("base: lndlr\n")
    with pytest.raises(
        UserError, match=r"mine/own\.yaml: base: .*'lndlr' is unknown; did you mean"
    ):
        load_config("mine/own.yaml")


def test_a_scenario_may_lie_beside_or_in_the_working_folder() -> None:
    text = (REPOSITORY_CONFIGS / "scenarios/hall.yaml").read_text()
    Path("here.yaml").write_text(text)
    Path("mine").mkdir()
    Path("mine/there.yaml").write_text(text)
    Path("mine/own.yaml").write_text("scenario: there.yaml\n")
    assert load_config("mine/own.yaml").scenario == load_scenario("here.yaml")
    assert load_config("lndrl", ["scenario=here.yaml"]).scenario.name == "hall"
