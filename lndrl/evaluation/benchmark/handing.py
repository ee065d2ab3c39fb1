"""Results that are handed on: packed into a folder, and those that come with the program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lndrl.config import REPOSITORY_CONFIGS
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.spec import BenchmarkSpec, check_frozen
from lndrl.evaluation.benchmark.store import IDENTITY, Identity, ResultsFolder

SHIPPED = REPOSITORY_CONFIGS.parent / "docs" / "results"
"""Where a checkout has results of the frozen bench, ``v1``, ``v2`` by version; a wheel has none."""


def shipped_results(spec: BenchmarkSpec, file: Path) -> ResultsFolder | None:
    """The results of ``spec`` that come with the program, if it is read from a ``file`` that does.

    None where there are none of its version.
    """
    folder = ResultsFolder(SHIPPED / f"v{spec.version}")
    ours = file.resolve().parent == REPOSITORY_CONFIGS
    return folder if ours and (folder.path / IDENTITY).is_file() else None


def check_bench(spec: BenchmarkSpec, folder: ResultsFolder) -> None:
    """See that ``folder`` has results of ``spec``, its version and its frozen scenarios.

    Raises UserError: they would stand in one table with those of another bench.
    """
    identity = Identity.read(folder.path / IDENTITY)
    if identity.bench_version != spec.version:
        raise UserError(
            f"{folder.path} holds results of version {identity.bench_version} of the bench, which "
            f"do not go into one table with those of version {spec.version}; name the --spec that "
            "they were tested with, or test anew under another --name"
        )
    check_frozen(spec, identity.scenarios)


def pack(
    folder: ResultsFolder,
    target: Path,
    episodes: int,
    methods: Sequence[str] | None = None,
    scenarios: Sequence[str] | None = None,
) -> list[Path]:
    """Write the first ``episodes`` of all that ``folder`` holds to ``target``, compressed.

    ``methods`` and ``scenarios`` by default are all tested. Same results, same bytes. Returns the
    files. Raises UserError where an episode is missing, and where ``target`` holds
    results of another bench or cannot be written.
    """
    identity = Identity.read(folder.path / IDENTITY)
    places = list(identity.scenarios) if scenarios is None else list(scenarios)
    names = list(identity.methods) if methods is None else list(methods)
    found = {
        (name, place): {k: r for k, r in folder.records(name, place).items() if k < episodes}
        for name in names
        for place in places
    }
    for (name, place), records in found.items():
        if len(records) < episodes:
            raise UserError(
                f"{folder.path}: has {len(records)} of {episodes} episodes of {name} on {place}; "
                "let lndrl benchmark end, or name what there is with --methods, --scenarios and "
                "--episodes"
            )
    packed = ResultsFolder(target)
    packed.claim(
        replace(
            identity,
            scenarios={place: identity.scenarios[place] for place in places},
            methods={name: identity.methods[name] for name in names},
            changes={place: what for place, what in identity.changes.items() if place in places},
        )
    )
    for (name, place), records in found.items():
        packed.pack(name, place, records.values())
    return [packed.packed(name, place) for name, place in found]
