"""Settings and scenarios by the names that a user types."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lndrl.config import REPOSITORY_CONFIGS, LocalizationConfig, load_scenario
from lndrl.config.localization import PRESETS
from lndrl.errors import UserError
from lndrl.models import load_yaml, validate
from lndrl.numbering import by_number
from lndrl.scenario import Scenario


def load_settings(name: str) -> LocalizationConfig:
    """The preset ``name``, or what a YAML file of ``localization`` keys says.

    The file may hold a whole configuration; its ``localization`` counts. Raises UserError naming
    the setting, or file and key.
    """
    if name.endswith((".yaml", ".yml")):
        data = load_yaml(Path(name))
        config = validate(LocalizationConfig, data.get("localization", data), name)
    elif name in PRESETS:
        config = validate(LocalizationConfig, {"preset": name}, f"--settings {name}")
    else:
        raise UserError(
            f"--settings {name}: unknown; known: {', '.join(PRESETS)}, or give a YAML file of "
            "localization keys"
        )
    if config.kind != "amcl":
        raise UserError(f"--settings {name}: kind {config.kind} has no errors to report; use amcl")
    return config


def label_of(name: str) -> str:
    """What a setting is called in tables: the preset, or the file's name without ending."""
    return Path(name).stem if name.endswith((".yaml", ".yml")) else name


def known_scenarios() -> list[str]:
    """Names of the drawn scenarios that come with the program, in alphabetical order.

    Without generated ones: every seed of a report drives in the same place.
    """
    names = sorted(
        (path.stem for path in (REPOSITORY_CONFIGS / "scenarios").glob("*.yaml")), key=by_number
    )
    return [name for name in names if load_scenario(name).kind == "geometry"]


def scenarios_named(names: Sequence[str]) -> list[Scenario]:
    """Scenarios by name or YAML file; ``all`` stands for all that come with the program.

    Raises UserError for unknown ones, and for a mixture: a report is of places.
    """
    wanted = [each for name in names for each in (known_scenarios() if name == "all" else [name])]
    found = [load_scenario(name) for name in dict.fromkeys(wanted)]
    for scenario in found:
        if scenario.mixed is not None:
            places = ", ".join(part.name for part in scenario.parts)
            raise UserError(f"scenario {scenario.name} is several places; name those: {places}")
    return found


def with_pedestrians(scenario: Scenario, count: int) -> Scenario:
    """``scenario`` with exactly ``count`` pedestrians; raises UserError where nobody can walk."""
    data = scenario.model_dump()
    data["pedestrians"]["count"] = (count, count)
    return validate(Scenario, data, f"scenario {scenario.name} with {count} pedestrians")
