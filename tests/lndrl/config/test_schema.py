"""The schemas that editors check configuration files by are the current ones."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from lndrl.cli.config import _kinds, _model
from lndrl.config import REPOSITORY_CONFIGS, Kind, keys, shipped
from lndrl.config.localization import PRESETS
from lndrl.config.schema import schema_file, schema_text

FILES = [(kind, path) for kind in _kinds() for path in shipped(kind).values()]


@pytest.mark.parametrize("kind", _kinds())
def test_the_shipped_schema_is_the_current_one(kind: Kind) -> None:
    assert schema_file(kind).read_text() == schema_text(_model(kind)), "run make schemas"


@pytest.mark.parametrize(("kind", "path"), FILES, ids=str)
def test_every_shipped_file_names_its_schema(kind: Kind, path: Path) -> None:
    named = re.match(r"# yaml-language-server: \$schema=(\S+)\n", path.read_text())
    assert named is not None
    assert (path.parent / named[1]).resolve() == schema_file(kind).resolve()


def resolved(schema: dict[str, Any], node: dict[str, Any]) -> dict[str, Any]:
    """What ``node`` refers to, through what else it may be."""
    for option in [node, *node.get("anyOf", [])]:
        if "$ref" in option:
            found: dict[str, Any] = schema["$defs"][option["$ref"].rpartition("/")[2]]
            return found
        if "items" in option:
            return resolved(schema, option["items"])
        if isinstance(option.get("additionalProperties"), dict):  # a mapping of names to entries
            return resolved(schema, option["additionalProperties"])
    return node


def test_every_key_is_in_the_schema_with_its_description() -> None:
    schema = json.loads(schema_file("configuration").read_text())
    for name, key in keys().items():
        node = schema
        for part in name.split("."):
            node = resolved(schema, node)["properties"][part]
        assert node["description"] == key.description, name


def test_a_file_may_leave_out_what_its_base_says_and_name_places_and_presets() -> None:
    schema = json.loads(schema_file("configuration").read_text())
    assert "required" not in schema
    assert schema["properties"]["base"]["type"] == "string"
    assert {"type": "string"} in schema["properties"]["scenario"]["anyOf"]
    named = {"type": "string", "enum": list(PRESETS)}
    assert named in schema["properties"]["localization"]["anyOf"]


@pytest.mark.parametrize("kind", ["configuration", "scenario"])
def test_places_of_a_mixture_may_be_named(kind: Kind) -> None:
    part = json.loads(schema_file(kind).read_text())["$defs"]["Part"]
    assert {"type": "string"} in part["properties"]["scenario"]["anyOf"]


def test_an_unknown_key_is_wrong_for_an_editor_too() -> None:
    schema = json.loads(schema_file("configuration").read_text())
    assert schema["additionalProperties"] is False
    models = {name: each for name, each in schema["$defs"].items() if name != "JsonValue"}
    assert all(each["additionalProperties"] is False for each in models.values())
    assert schema_file("sweep").parent == REPOSITORY_CONFIGS / "schemas"
