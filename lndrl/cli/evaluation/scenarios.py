"""``lndrl scenarios``: which places there are, and what they look like."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lndrl.cli.again import same_command
from lndrl.cli.completion import complete_scenario
from lndrl.cli.help import say_next
from lndrl.cli.notes import say_notes
from lndrl.cli.options import TrustModules, check_picture, trust
from lndrl.cli.signals import telling
from lndrl.errors import UserError
from lndrl.numbering import by_number
from lndrl.wording import counted, people

if TYPE_CHECKING:
    from lndrl.maps.localizability import LocalizabilityField
    from lndrl.scenario import Box, Scenario
    from lndrl.world import Place


@telling(lambda: f"pictures that are whole are kept; begin again with: {same_command()}")
def scenarios(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="Name or YAML file; default: all that are known.",
            autocompletion=complete_scenario,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw NAME into this file.")
    ] = None,
    draw: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Draw all into this folder.")
    ] = None,
    layout: Annotated[
        int, typer.Option(metavar="K", min=0, help="Which of a random scenario's layouts.")
    ] = 0,
    localizability: Annotated[
        bool,
        typer.Option(
            "--localizability", help="How well a scan pins the pose down, all over the place."
        ),
    ] = False,
    trust_modules: TrustModules = None,
    json: Annotated[
        bool, typer.Option("--json", help="As JSON; with NAME: with regions and routes.")
    ] = False,
) -> None:
    """List the places to train and test in, and draw them."""
    _check(name, out, draw)
    if localizability and name is None and draw is None:
        raise UserError("--localizability: name the scenario, or use --draw FOLDER for all")
    trust(trust_modules)
    if name is None:
        _all(draw, layout, json, localizability)
    else:
        _one(name, out, layout, json, localizability)


def _all(draw: Path | None, layout: int, json: bool, localizability: bool) -> None:
    from lndrl.cli.tables import print_tables
    from lndrl.config import REPOSITORY_CONFIGS, load_scenario

    folder = REPOSITORY_CONFIGS / "scenarios"
    known = [load_scenario(path.stem) for path in sorted(folder.glob("*.yaml"))]
    known.sort(key=lambda scenario: (scenario.kind, by_number(scenario.name)))
    if json:
        typer.echo(json_format.dumps([_summary(scenario) for scenario in known], indent=2))
    elif draw is None:
        print_tables(_table(known))
        say_next("lndrl", "scenarios", "hall", "--out", "hall.png", then="a picture of one")
    if draw is None:
        return
    draw.mkdir(parents=True, exist_ok=True)
    for scenario in known:
        place = _build(scenario, layout)
        field = _field(place) if localizability else None
        _draw(place, draw / f"{scenario.name}.png", scenario, json, field)


def _one(name: str, out: Path | None, layout: int, json: bool, localizability: bool) -> None:
    from lndrl.cli.tables import print_tables
    from lndrl.config import load_scenario

    scenario = load_scenario(name)
    place = _build(scenario, layout)
    field = _field(place) if localizability else None
    if json:
        told = _summary(scenario) | _details(place)
        if field is not None:
            told["localizability"] = _shares(field)
        typer.echo(json_format.dumps(told, indent=2))
    elif out is None and field is not None:
        _say_shares(scenario.name, field)
    elif out is None:
        print_tables(_table([scenario]))
        typer.echo(
            f"{counted(len(place.scenario.robot), 'task')}, "
            f"{counted(len(place.scenario.pedestrians.routes), 'route')} of pedestrians; "
            "--out FILE.png draws them, --json lists them"
        )
        say_next("lndrl", "evaluate", "straight", "--scenario", name, "--episodes", 40)
    say_notes(place.notes)
    if out is not None:
        _draw(place, out, scenario, json, field)


def _field(place: Place) -> LocalizabilityField:
    """That of the laser and the filter of the defaults, which are the paper's."""
    from lndrl.config import LaserConfig, LocalizationConfig
    from lndrl.localization.localizability import localizability_field

    return localizability_field(place.grid, place.cells, LaserConfig(), LocalizationConfig())


def _shares(field: LocalizabilityField) -> dict[str, Any]:
    """Deviations (m) over all places that are free and all headings."""
    import numpy as np

    values = field.deviation[field.free]
    if not len(values):
        values = np.full((1, 1), field.sensor.farthest)
    quantiles = np.quantile(values, [0.1, 0.5, 0.9])
    return {
        "map_hash": field.map_hash,
        "spacing": round(field.spacing, 3),
        "deviation_10": round(float(quantiles[0]), 4),
        "deviation_50": round(float(quantiles[1]), 4),
        "deviation_90": round(float(quantiles[2]), 4),
        "share_unknown": round(float((values >= field.sensor.farthest).mean()), 4),
    }


def _say_shares(name: str, field: LocalizabilityField) -> None:
    told = _shares(field)
    typer.echo(
        f"{name} (map {told['map_hash']}): one scan tells the position to "
        f"{told['deviation_50']:.2f} m in the median over places and headings, to "
        f"{told['deviation_90']:.2f} m in 90 % of them; in {100 * told['share_unknown']:.1f} % it "
        f"tells nothing along some direction; --out FILE.png draws it"
    )


def _build(scenario: Scenario, layout: int) -> Place:
    from lndrl.world import Place

    return Place.build(scenario, layout=layout)


def _draw(
    place: Place, file: Path, scenario: Scenario, quiet: bool, field: LocalizabilityField | None
) -> None:
    from lndrl.view.pictures.localizability import save_localizability
    from lndrl.view.pictures.scenario import save_scenario

    crowd = people(place.scenario.pedestrians.count)
    width, height = place.grid.size
    title = f"{place.scenario.name}   {width:.4g} × {height:.4g} m, {crowd}"
    try:
        if field is None:
            save_scenario(place, file, title)
        else:
            save_localizability(place, field, file, title)
    except OSError as error:
        raise UserError(f"{file}: cannot be written ({error.strerror})") from None
    if not quiet:
        typer.echo(f"{file}: {scenario.description or scenario.name}")


def _table(known: list[Scenario]) -> Any:
    from rich.table import Table

    table = Table()
    table.add_column("name")
    table.add_column("kind")
    table.add_column("size (m)", justify="right")
    table.add_column("people", justify="right")
    table.add_column("description")
    for scenario in known:
        fewest, most = _count(scenario)
        people = f"{fewest}" if fewest == most else f"{fewest}–{most}"
        size = f"{scenario.size[0]:.4g} × {scenario.size[1]:.4g}" if min(scenario.size) > 0 else "–"
        table.add_row(scenario.name, scenario.kind, size, people, scenario.description)
    return table


def _count(scenario: Scenario) -> tuple[int, int]:
    """Fewest and most people, over all places that it stands for."""
    counts = [part.pedestrians.count for part in scenario.parts]
    return min(fewest for fewest, _ in counts), max(most for _, most in counts)


def _summary(scenario: Scenario) -> dict[str, Any]:
    return {
        "name": scenario.name,
        "kind": scenario.kind,
        "size": [round(side, 3) for side in scenario.size],
        "resolution": scenario.resolution,
        "pedestrians": list(_count(scenario)),
        "start_goal_distance": scenario.start_goal_distance,
        "description": scenario.description,
    }


def _details(place: Place) -> dict[str, Any]:
    """Regions and routes in the frame of the map, ready to be copied into a YAML file."""
    ox, oy = place.map_origin

    def box(b: Box) -> list[float]:
        return [round(v, 2) for v in (b[0] + ox, b[1] + oy, b[2] + ox, b[3] + oy)]

    return {
        "layout": place.scenario.name,
        "origin": [round(ox, 4), round(oy, 4)],
        "start_goal_distance": place.scenario.start_goal_distance,
        "pedestrians": list(place.scenario.pedestrians.count),
        "robot": [
            {"start": box(task.start), "goal": box(task.goal)} for task in place.scenario.robot
        ],
        "routes": [
            {
                "start": box(route.start),
                "goal": box(route.goal),
                "via": [[round(x + ox, 2), round(y + oy, 2)] for x, y in route.via],
            }
            for route in place.scenario.pedestrians.routes
        ],
        "wall_edges": len(place.walls),
        "notes": list(place.notes),
    }


def _check(name: str | None, out: Path | None, draw: Path | None) -> None:
    if out is not None and draw is not None:
        raise UserError("--out and --draw: give one of them")
    if out is not None:
        if name is None:
            raise UserError(f"--out {out}: name the scenario to draw, or use --draw FOLDER for all")
        check_picture(out)
    if draw is not None:
        if name is not None:
            raise UserError(f"--draw {draw} draws all; use --out FILE.png to draw {name}")
        if draw.exists() and not draw.is_dir():
            raise UserError(f"--draw {draw}: is a file; name a folder")
