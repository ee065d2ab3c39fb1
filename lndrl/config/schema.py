"""JSON schemas of the files that come with the program, for editors and checkers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from lndrl.config.localization import PRESETS
from lndrl.config.run import RunConfig
from lndrl.config.shipped import REPOSITORY_CONFIGS, Kind
from lndrl.config.world import ROBOT_PRESETS

SCHEMAS = REPOSITORY_CONFIGS / "schemas"


def schema_file(kind: Kind | Literal["metrics"]) -> Path:
    """Where the schema of ``kind`` lies; metrics are the lines of a run's ``metrics.jsonl``."""
    return SCHEMAS / f"{kind}.json"


def schema_text(model: type[BaseModel]) -> str:
    """The schema of a file that ``model`` reads, as the text of ``schema_file``."""
    schema = model.model_json_schema()
    if model is RunConfig:
        schema = _of_a_configuration(schema)
    if part := schema.get("$defs", {}).get("Part"):
        place = part["properties"]["scenario"]
        part["properties"]["scenario"] = _or(place, {"type": "string"})
    schema = _plain(schema)
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return json.dumps(dialect | schema, indent=2, ensure_ascii=False) + "\n"


def _of_a_configuration(schema: dict[str, Any]) -> dict[str, Any]:
    """``schema`` with what a file may say and the model never sees, because it is resolved."""
    keys = dict(schema["properties"])
    keys["scenario"] = _or(keys["scenario"], {"type": "string"})
    presets = {"type": "string", "enum": list(PRESETS)}
    keys["localization"] = _or(keys["localization"], presets)
    if world := schema.get("$defs", {}).get("WorldConfig"):
        robots = {"type": "string", "enum": list(ROBOT_PRESETS)}
        world["properties"]["robot"] = _or(world["properties"]["robot"], robots)
    base = (
        "configuration whose keys this one changes: a name, or a file relative to this one; {} "
        "empties what it has under a key"
    )
    keys = {"base": {"type": "string", "description": base}, **keys}
    # Whatever is missing may stand in the base.
    return {**{k: v for k, v in schema.items() if k != "required"}, "properties": keys}


def _plain(schema: Any) -> Any:
    """``schema`` without what only repeats: titles made of names, defaults that hold keys."""
    if isinstance(schema, list):
        return [_plain(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    if "title" in schema and isinstance(schema["title"], str):
        schema = {name: value for name, value in schema.items() if name != "title"}
    if isinstance(schema.get("default"), dict) and "description" in schema:
        schema = {name: value for name, value in schema.items() if name != "default"}
    return {name: _plain(value) for name, value in schema.items()}


def _or(key: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    said = {name: value for name, value in key.items() if name != "$ref"}
    return {**said, "anyOf": [other, {"$ref": key["$ref"]}]}
