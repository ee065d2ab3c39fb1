"""Errors of configuration files are sentences that name file, key and mend."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pytest
from pydantic import Field

from lndrl.errors import UserError
from lndrl.models import LATER, Later, Model, effective, load_yaml, validate


class Wheel(Model):
    radius: float = Field(0.05, gt=0)
    count: int = 2


class Robot(Model):
    name: str
    wheels: list[Wheel] = Field(default_factory=list)
    spare: Wheel = Wheel()


def refusal(data: object) -> str:
    with pytest.raises(UserError) as caught:
        validate(Robot, data, "robot.yaml")
    return str(caught.value)


def test_plain_data_becomes_a_model() -> None:
    robot = validate(Robot, {"name": "r", "wheels": [{"radius": 0.1}]}, "robot.yaml")
    assert robot == Robot(name="r", wheels=[Wheel(radius=0.1)])


def test_models_are_frozen() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Wheel().radius = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({"nam": "r"}, "robot.yaml: name is missing; robot.yaml: unknown key nam; did you mean"),
        ({"name": "r", "spare": {"radios": 1}}, "unknown key spare.radios; did you mean radius?"),
        ({"name": "r", "wheels": [{"cuont": 1}]}, "unknown key wheels.0.cuont; did you mean count"),
        ({"name": "r", "zzz": 1}, "unknown key zzz; known: name, spare, wheels"),
        ({"name": "r", "spare": {"radius": -1}}, "robot.yaml: spare.radius = -1: input should be"),
        ({"name": "r", "spare": {"radius": float("nan")}}, "spare.radius = nan"),
        ({"name": "r", "spare": {"count": 1.5}}, "spare.count = 1.5"),
        ({"name": "r", "wheels": 3}, "wheels = 3"),
    ],
)
def test_a_refusal_names_the_key(data: object, sentence: str) -> None:
    assert sentence in refusal(data)


def test_yaml_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: {b: [1, 2]}\n")
    assert load_yaml(path) == {"a": {"b": [1, 2]}}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"a: 1\nb: [1\n", "line 3"),
        (b"a: 1\n b: 2\n", "line 2"),
        (b"- 1\n- 2\n", "must hold keys and values, not list"),
        (b"", "must hold keys and values, not NoneType"),
        (b"a: \xff\xfe\n", "cannot be read"),
        (b"a: !!python/object/apply:os.getcwd []\n", "could not determine a constructor"),
    ],
)
def test_files_that_are_no_configuration(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "broken.yaml"
    path.write_bytes(content)
    with pytest.raises(UserError) as caught:
        load_yaml(path)
    assert str(path) in str(caught.value)
    assert sentence in str(caught.value)


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"nowhere\.yaml: no such file"):
        load_yaml(tmp_path / "nowhere.yaml")
    with pytest.raises(UserError, match="cannot be read"):
        load_yaml(tmp_path)


class Trailer(Model):
    length: float = 1.0
    lamps: Annotated[int, LATER] = 0


class Convoy(Model):
    trailers: list[Trailer] = Field(default_factory=list)
    named: dict[str, Trailer] = Field(default_factory=dict)
    speed: Annotated[float | None, LATER] = None
    lane: Annotated[str, Later("left")] = "right"


def test_a_later_key_at_its_default_is_no_part_of_what_is_hashed() -> None:
    convoy = Convoy(trailers=[Trailer()], named={"last": Trailer(lamps=2)}, lane="left")
    assert effective(convoy) == {
        "trailers": [{"length": 1.0}],
        "named": {"last": {"length": 1.0, "lamps": 2}},
    }
    assert effective(Convoy(speed=1.5))["speed"] == 1.5
    assert effective(Convoy())["lane"] == "right"  # a default that is new behaviour counts
