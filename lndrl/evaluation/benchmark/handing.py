"""Results that are handed on: packed into a folder, and those that come with the program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lndrl.config import REPOSITORY_CONFIGS
from lndrl.config.shipped import SHIPPED_POLICIES
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.spec import BenchmarkSpec, check_frozen
from lndrl.evaluation.benchmark.store import IDENTITY, Identity, ResultsFolder
from lndrl.evaluation.benchmark.trainings import (
    Training,
    read_training,
    training_file,
    training_of,
    write_training,
)

SHIPPED = REPOSITORY_CONFIGS.parent / "docs" / "results"
"""Where a checkout has results of the frozen bench, ``v1``, ``v2`` by version; a wheel has none."""
_RULE = "rule"  # the actions of who has no weights


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


def trainings_of(
    folder: ResultsFolder, methods: Sequence[str] | None = None, runs: Path = Path()
) -> dict[str, Training | None]:
    """How the learned ``methods`` of ``folder``, by default all, were trained, by method.

    Of what ``folder`` keeps, else of the method's run folder (below ``runs``, as methods name them)
    where the policy that was tested is still in it, else None: only its episodes are left. Rules
    and policies that come with the program are left out. Raises UserError where what ``folder``
    keeps is damaged.
    """
    read: dict[tuple[Path, str], Training | None] = {}
    found: dict[str, Training | None] = {}
    for name, method in Identity.read(folder.path / IDENTITY).methods.items():
        planner, identity = method.get("planner", ""), method.get("identity", "")
        if method.get("actions", _RULE) == _RULE or planner in SHIPPED_POLICIES:
            continue
        if methods is None or name in methods:
            key = Path(planner), identity.partition(" ")[0]
            if key not in read:
                read[key] = _kept_or_at_hand(folder.path, runs / planner, key[1])
            found[name] = read[key]
    return found


def _kept_or_at_hand(folder: Path, run: Path, policy: str) -> Training | None:
    kept = training_file(folder, run.name, policy)
    if kept.is_file():
        return read_training(kept)
    try:
        return training_of(run, policy)
    except UserError:  # of a program that is long gone, or damaged: episodes are shown without
        return None


def pack_trainings(
    folder: ResultsFolder, target: Path, methods: Sequence[str] | None = None
) -> tuple[list[Path], list[str]]:
    """Write how the learned ``methods`` of ``folder`` were trained to ``target``, a file a policy.

    By default all. Returns the files, and the methods of which ``target`` has none.
    """
    found = trainings_of(folder, methods)
    known = {training.policy: training for training in found.values() if training is not None}
    files = [write_training(target, training) for training in known.values()]
    return files, [
        name
        for name, there in trainings_of(ResultsFolder(target), list(found)).items()
        if there is None
    ]
