"""The page about results of the bench, and their worst episodes, driven again where they can be."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lndrl.cli.notes import say_notes
from lndrl.cli.reporting.machine import machine_section, made
from lndrl.errors import UserError
from lndrl.view.report.parts import Page, Section

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark import Recorded, ResultsFolder, Row
    from lndrl.evaluation.benchmark.results import Results
    from lndrl.view.pictures.worst import Panel


def results_page(path: Path, worst: int, reference: str | None, spec: str | None) -> Page:
    """Everything that the results in ``path`` say of the bench ``spec``.

    ``worst`` episodes of the reference row are shown. Raises UserError as ``gather`` does.
    """
    from lndrl.config import DEFAULTS, find
    from lndrl.evaluation.benchmark import ResultsFolder, load_benchmark
    from lndrl.evaluation.benchmark.results import gather
    from lndrl.view.report.bench import identity_section, results_sections

    bench = load_benchmark(find("bench", spec or DEFAULTS["bench"]))
    folder = ResultsFolder(path)
    results = gather(bench, folder, reference=reference)
    gallery = [_gallery(folder, results, worst)] if worst else []
    sections = [
        *results_sections(results),
        *gallery,
        identity_section(results),
        machine_section([("tested by", f"lndrl {results.identity.program_version}")]),
    ]
    episodes = sum(len(row.records) for row in results.rows)
    lead = (
        f"{len(results.rows)} methods in {len(results.scenarios)} scenarios, {episodes:,} "
        f"episodes; compared with {results.reference.method}."
    )
    title = f"Results {results.name}"
    return Page(title, lead, sections, made(), f"bench version {bench.version}", "quiet")


def _gallery(folder: ResultsFolder, results: Results, count: int) -> Section:
    """The worst episodes of the reference row, as pictures or, where that fails, as a table."""
    from lndrl.evaluation.benchmark import worst_episodes
    from lndrl.view.report.bench import worst_table
    from lndrl.view.report.episodes import gallery_section

    reference = results.reference
    told, tables = "", []
    for row in (reference, *_others(results)):
        rows = worst_episodes(folder, row.method, row.scenarios, count)
        if row is reference:
            tables.append(worst_table(rows, row.method))
        try:
            panels = _driven_again(folder, row.method, rows)
        except UserError as error:
            if row is reference:
                say_notes([f"the worst episodes of {row.method} are listed, not drawn: {error}"])
                told = f"{row.method} cannot be driven again here, so its worst are listed below. "
            continue
        words = f"{told}The {len(panels)} worst of {row.method} in all scenarios, driven again"
        return gallery_section(panels, words, tables)
    return gallery_section([], told.removesuffix(". "), tables)


def _others(results: Results) -> list[Row]:
    """Rows that are shown where the reference cannot be driven again: who arrives most, first.

    Who is told the truth never gets lost, and shows little.
    """
    methods = results.identity.methods
    amcl = [row for row in results.rows if methods[row.method].get("localization") != "perfect"]
    others = [row for row in amcl if row is not results.reference]
    return sorted(others, key=lambda row: -row.metrics.arrival.value)


def _driven_again(folder: ResultsFolder, method: str, rows: Sequence[Recorded]) -> list[Panel]:
    """A panel for each of ``rows``, in their order; raises UserError where that is impossible."""
    from lndrl.evaluation.benchmark import contender_tested, drive_again
    from lndrl.view.pictures.worst import Panel
    from lndrl.view.progress import progress_bar

    contender, identity = contender_tested(folder, method)
    with progress_bar(len(rows), f"driving the worst of {method}", "episodes") as advance:
        found = drive_again(
            folder, identity, contender, rows, lambda drive: advance(1, drive.reason)
        )
    return [Panel(drive, otherwise) for drive, otherwise in found]
