"""``lndrl config``: which configurations there are, what they say, what their keys mean."""

from __future__ import annotations

import json as json_format
import re
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from lndrl.cli.completion import complete_configuration, complete_key, complete_shown
from lndrl.cli.help import say_next
from lndrl.cli.options import Settings

if TYPE_CHECKING:
    from pydantic import BaseModel

    from lndrl.config import Key, Kind, RunConfig

config = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Show, compare and explain configurations.",
)
METRICS = "metrics"
"""Beside the kinds of files that come with the program: what a run writes."""
_LONGEST = 60  # characters of a value that a table holds


@config.command("show")
def show(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="Name, YAML file or run folder; default: list all that come with the program.",
            autocompletion=complete_shown,
        ),
    ] = None,
    settings: Settings = None,
) -> None:
    """Print a configuration with every key, as YAML that lndrl train reads back.

    Of a scenario, sweep or bench that comes with the program: its file.
    """
    from lndrl.config import find, load_config, shipped
    from lndrl.config.schema import schema_file

    if name is None:
        _list()
        return
    others = [kind for kind in _kinds() if kind != "configuration" and name in shipped(kind)]
    if others:
        typer.echo(shipped(others[0])[name].read_text(encoding="utf-8"), nl=False)
        return
    chosen = load_config(name, settings or [])
    typer.echo(f"# yaml-language-server: $schema={schema_file('configuration')}")
    typer.echo(f"# {find('configuration', name)}" + "".join(f" {s}" for s in settings or []))
    typer.echo(_yaml(chosen), nl=False)


@config.command("explain")
def explain(
    key: Annotated[
        str | None,
        typer.Argument(
            metavar="[KEY]",
            help="Dotted key, e.g. ppo.epochs, or one that holds others, e.g. ppo; default: all.",
            autocompletion=complete_key,
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
) -> None:
    """Say what a key means, what it may be, its default, and where its number comes from."""
    from lndrl.config import SOURCES, find_keys, keys

    found = list(keys().values()) if key is None else find_keys(key)
    if json:
        typer.echo(json_format.dumps([vars(each) for each in found], indent=2))
        return
    for each in found:
        typer.echo(each.name)
        typer.echo(f"    {each.description}")
        if each.is_value:
            typer.echo(f"    {each.kind}; default {each.default}")
            values = _shipped_values(each) if len(found) == 1 else ""
            if values:
                typer.echo(f"    {values}")
    for source, meaning in SOURCES.items():
        if any(source in each.description for each in found):
            typer.echo(f"{source}: {meaning}")
    if len(found) == 1 and found[0].is_value and not found[0].default.startswith("none;"):
        value = f"{found[0].name}={found[0].default}"
        say_next("lndrl", "train", "--set", value, then="with a value of yours")


@config.command("diff")
def diff(
    first: Annotated[
        str,
        typer.Argument(
            metavar="A",
            help="Name, YAML file or run folder.",
            autocompletion=complete_configuration,
        ),
    ],
    second: Annotated[
        str,
        typer.Argument(
            metavar="B", help="The one beside it.", autocompletion=complete_configuration
        ),
    ],
    json: Annotated[bool, typer.Option("--json", help="As JSON: key to both values.")] = False,
) -> None:
    """List the keys in which two configurations differ, whatever they leave to defaults."""
    from lndrl.config import differences, load_config

    different = differences(load_config(first), load_config(second))
    if json:
        typer.echo(json_format.dumps(different, indent=2))
    elif not different:
        typer.echo(f"{first} and {second} say the same")
    else:
        from rich.markup import escape
        from rich.table import Table

        from lndrl.cli.tables import print_tables

        table = Table("key", escape(first), escape(second))
        for key, values in different.items():
            table.add_row(key, *(escape(_short(value)) for value in values))
        print_tables(table)


@config.command("schema")
def schema(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="[KIND]", help="configuration, scenario, sweep, bench, ..., or metrics"
        ),
    ] = "configuration",
) -> None:
    """Print the JSON schema of configuration files, which editors complete and check by.

    metrics: of a line of a run's metrics.jsonl (docs/metrics.md).
    """
    from lndrl.config.schema import schema_text
    from lndrl.errors import UserError

    known = (*_kinds(), METRICS)
    if kind not in known:
        raise UserError(f"kind {kind!r} is unknown; known: {', '.join(known)}")
    typer.echo(schema_text(_model(kind)), nl=False)


def _kinds() -> tuple[Kind, ...]:
    from lndrl.config import Kind

    return get_args(Kind)


def _model(kind: str) -> type[BaseModel]:
    """What reads files of ``kind``; the evaluation's are imported when they are asked for."""
    if kind == METRICS:
        from lndrl.view.run_rows import MetricsRow

        return MetricsRow
    if kind == "sweep":
        from lndrl.evaluation.sweep.spec import SweepSpec

        return SweepSpec
    if kind in ("bench", "calibration"):
        from lndrl.evaluation.benchmark.calibration import CalibrationSpec
        from lndrl.evaluation.benchmark.spec import BenchmarkSpec

        return BenchmarkSpec if kind == "bench" else CalibrationSpec
    if kind == "robot":
        from lndrl.robot.shapes import RobotShape

        return RobotShape
    from lndrl.config import RunConfig
    from lndrl.scenario import Scenario

    return Scenario if kind == "scenario" else RunConfig


def _list() -> None:
    """Names by kind, each with what it is in a line."""
    from lndrl.config import REPOSITORY_CONFIGS, shipped

    for kind in _kinds():
        typer.echo(f"{kind}:")
        for name, path in shipped(kind).items():
            headline = textwrap.shorten(_headline(path), 74, placeholder=" …")
            typer.echo(f"    {name:<20} {headline}")
    typer.echo(f"files: {REPOSITORY_CONFIGS}")
    say_next("lndrl", "config", "show", "lndrl", then="all keys of one")


def _headline(path: Path) -> str:
    """A file's description, else the first sentence of the comment that it begins with."""
    from lndrl.models import load_yaml

    description = load_yaml(path).get("description")
    if description:
        return str(description)
    said = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        if "yaml-language-server" not in line:
            said.append(line.removeprefix("#").strip())
    return re.split(r"\.(?: (?=[A-Z])|$)", " ".join(said))[0]


def _yaml(chosen: RunConfig) -> str:
    """All keys as YAML; a scenario that comes with the program by its name."""
    import yaml

    from lndrl.config import load_scenario, shipped

    data = chosen.model_dump(mode="json")
    name = chosen.scenario.name
    if name in shipped("scenario") and load_scenario(name) == chosen.scenario:
        data["scenario"] = name
    return yaml.dump(data, Dumper=_dumper(), sort_keys=False, width=100)


def _dumper() -> Any:
    import yaml

    class Dumper(yaml.SafeDumper):
        """Lists of plain values on one line, as people write them."""

        def represent_plain(self, data: list[Any]) -> yaml.Node:
            flow = not any(isinstance(each, dict) for each in data)
            return self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flow)

    Dumper.add_representer(list, Dumper.represent_plain)
    return Dumper


def _shipped_values(key: Key) -> str:
    """What the configurations that come with the program say where it is not the default."""
    from lndrl.config import flatten, load_config, shipped

    said = []
    for name, path in shipped("configuration").items():
        value = flatten(load_config(path).model_dump(mode="json")).get(key.name)
        if value is not None and _short(value) != key.default and not key.name.startswith("scenar"):
            said.append(f"{name} {_short(value)}")
    return ", ".join(said)


def _short(value: Any) -> str:
    import yaml

    if value is None:
        return "null"
    words = yaml.safe_dump(value, default_flow_style=True, width=10**6).removesuffix("\n...\n")
    words = words.strip()
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 1]}…"
