"""Every key says what it means."""

from __future__ import annotations

import re

import pytest
import yaml

from lndrl.config import SOURCES, RunConfig, find_keys, flatten, keys, load_config
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.calibration import CalibrationSpec
from lndrl.evaluation.benchmark.spec import BenchmarkSpec
from lndrl.evaluation.sweep.spec import SweepSpec
from lndrl.models import Model

UNITS = {"m", "s", "rad", "m/s", "rad/s", "m^2", "rad^2", "1/m", "ROS", *SOURCES}


@pytest.mark.parametrize("model", [RunConfig, SweepSpec, BenchmarkSpec, CalibrationSpec])
def test_every_key_has_a_description(model: type[Model]) -> None:
    silent = []
    for key in keys(model).values():
        words = [word for word in re.findall(r"[^\s,;:()]+", key.description) if word not in UNITS]
        if len(words) < 2:  # a unit alone says nothing
            silent.append(key.name)
    assert silent == []


def test_keys_are_those_of_a_file() -> None:
    values = flatten(load_config("lndrl").model_dump())
    inside = {name for name, key in keys().items() if key.is_value}
    # A mapping whose entries have keys of their own, such as reward terms, is empty here.
    given = {name for name, value in values.items() if value != {}}
    # Nor are the names of a planner's parameters, which stand in a mapping that is one value.
    own = {name.rpartition(".")[0] if "settings." in name else name for name in given}
    assert {name for name in own if not name.startswith("scenario.")} <= inside
    assert {"scenario.robot.start", "scenario.cells.rows", "localization.preset"} <= set(keys())


def test_what_a_key_may_be_is_said_in_words() -> None:
    known = keys()
    assert known["ppo.epochs"].kind == "whole number, at least 1"
    assert known["ppo.gamma"].kind == "number, at least 0, at most 1"
    assert known["learner.mode"].kind == "async or lockstep"
    assert known["actor.count"].kind == "whole number or auto"
    assert known["ppo.minibatch_size"].kind == "whole number, at least 1 or null"
    assert known["scenario.size"].kind == "[number, number]"
    assert known["scenario.robot"].kind == "list of entries"
    assert "at most 16 of them" in known["task.linear_velocities"].kind
    assert not known["ppo"].is_value


def test_defaults_are_yaml_that_means_the_default() -> None:
    defaults = flatten(RunConfig(scenario=load_config("lndrl").scenario).model_dump(mode="json"))
    for name, value in defaults.items():
        if not name.startswith("scenario."):
            assert yaml.safe_load(keys()[name].default) == value, name


def test_a_key_is_found_with_what_it_holds() -> None:
    assert [key.name for key in find_keys("ppo.clip")] == ["ppo.clip"]
    reward = [key.name for key in find_keys("task.reward")]
    assert reward[0] == "task.reward" and "task.reward.lost" in reward
    assert len(find_keys("ppo")) > 15


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("ppo.epoch", "did you mean ppo.epochs"),
        ("epochs", "did you mean .*ppo.epochs"),
        ("nothing", "lndrl config explain lists all"),
    ],
)
def test_an_unknown_key_is_refused_with_the_nearest(name: str, hint: str) -> None:
    with pytest.raises(UserError, match=f"key {name} is unknown; .*{hint}"):
        find_keys(name)


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("task.reward.terms.mine.use", "task.reward.terms.use"),
        ("task.reward.terms.mine", "task.reward.terms"),
        ("task.reward.terms.use", "task.reward.terms.use"),
    ],
)
def test_a_name_that_a_user_gave_is_no_part_of_a_key(written: str, meant: str) -> None:
    assert find_keys(written)[0].name == meant


@pytest.mark.parametrize("name", ["task.reward.terms.mine.us", "ppo.mine.gamma"])
def test_only_entries_are_given_names(name: str) -> None:
    with pytest.raises(UserError, match=f"key {name} is unknown; did you mean"):
        find_keys(name)
