"""``lndrl calibrate --search``: all readings of what the paper leaves open, halved and judged."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lndrl.cli.evaluation.driving import drive_plans
from lndrl.errors import UserError

FOUND = "search.json"

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import CalibrationSpec
    from lndrl.evaluation.benchmark.halving import Search


def search_worlds(
    spec: CalibrationSpec, place: Path, table: bool, workers: int, json: bool
) -> None:
    """Run the search in ``place`` (unless only its ``table`` is asked for) and show it.

    Raises UserError where nothing has been judged yet.
    """
    from lndrl.evaluation.benchmark import ResultsFolder, load_benchmark
    from lndrl.evaluation.benchmark.halving import Search

    search = Search(spec, load_benchmark(), place)
    if not table:
        with ResultsFolder(place).locked():
            search.run(lambda title, plans: drive_plans(plans, title, place, workers))
        _write(search)
    verdicts = search.verdicts()
    if not verdicts:
        why = (
            "run it without --table" if table else f"{place / FOUND} says what each was dropped for"
        )
        raise UserError(f"{place}: no world has been judged; {why}")
    if json:
        typer.echo(json_format.dumps([v.to_dict() for v in verdicts], indent=2))
        return
    from lndrl.cli.tables import print_tables
    from lndrl.evaluation.benchmark.search_table import search_lines, search_table

    print_tables(search_table(search.search, verdicts))
    for line in search_lines(search, verdicts):
        typer.echo(line)


def _write(search: Search) -> None:
    """Beside the episodes, ``search.json``: every world, who was dropped and the judgements."""
    content = {
        "worlds": [world.name for world in search.worlds],
        "dropped": search.dropped,
        "judged": [verdict.to_dict() for verdict in search.verdicts()],
    }
    path = search.path / FOUND
    path.write_text(json_format.dumps(content, indent=1) + "\n", encoding="utf-8")
