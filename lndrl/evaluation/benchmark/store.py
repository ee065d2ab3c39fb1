"""A benchmark's folder: one row per episode, and what the rows are worth.

``benchmark.json`` says which bench, episodes, seed and planners the rows belong to;
``METHOD-SCENARIO.csv`` has the episodes of a method in a scenario, appended as they end;
``summary.json`` is written when all are there. Rows of another bench or other weights are refused,
not mixed. A folder to be handed on has ``METHOD-SCENARIO.csv.xz`` instead (``pack``), with the same
rows.
"""

from __future__ import annotations

import csv
import json
import lzma
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lndrl.errors import UserError
from lndrl.machine.lock import held
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.families import Family, episode_of
from lndrl.navigation.reward import REWARD_PARTS

IDENTITY = "benchmark.json"
SUMMARY = "summary.json"
COLUMNS = (
    "episode", "outcome", "steps", "time", "distance", "position_error", "angle_error",
    "variance_sum", "episode_return", *REWARD_PARTS,
)  # fmt: skip


@dataclass
class Identity:
    """What results in a folder stand for; ``scenarios`` and ``methods`` grow as more are tested.

    ``scenarios`` maps names to bench hashes, ``methods`` to planner, identity, actions,
    localization, ``changes`` scenarios to what was set in them (key=value). ``family`` says whose
    episodes they are, ``bench_version`` of which version of the bench; folders from before there
    were several are of the bench's first.
    """

    seed: int
    program_version: str
    scenarios: dict[str, str] = field(default_factory=dict)
    methods: dict[str, dict[str, str]] = field(default_factory=dict)
    changes: dict[str, list[str]] = field(default_factory=dict)
    family: str = Family.BENCH.value
    bench_version: int = 1

    @classmethod
    def read(cls, path: Path) -> Identity:
        """Raises UserError naming the file."""
        try:
            found = cls(**json.loads(path.read_text("utf-8")))
            Family(found.family)
        except (FileNotFoundError, NotADirectoryError):
            raise UserError(f"{path.parent}: holds no results of lndrl benchmark") from None
        except (OSError, ValueError, TypeError) as error:
            raise UserError(f"{path}: cannot be read ({error})") from None
        return found

    def write(self, path: Path) -> None:
        """Raises UserError where the disk refuses."""
        write_whole(path, json.dumps(vars(self), indent=1) + "\n")

    def check(self, folder: Path, wanted: Identity) -> None:
        """Raises UserError unless results of ``wanted`` may stand beside those in ``folder``."""
        other = "; delete the folder or choose another --name"
        if self.family != wanted.family:
            raise UserError(
                f"{folder} was filled with episodes of {self.family}, not of {wanted.family}{other}"
            )
        if self.bench_version != wanted.bench_version:
            raise UserError(
                f"{folder} holds results of version {self.bench_version} of the bench, which do "
                f"not go into one table with those of version {wanted.bench_version}{other}"
            )
        if self.seed != wanted.seed:
            raise UserError(f"{folder} was filled under seed {self.seed}, not {wanted.seed}{other}")
        for kind, ours, theirs in (
            ("scenario", wanted.scenarios, self.scenarios),
            ("method", wanted.methods, self.methods),
        ):
            for name, what in ours.items():
                if name in theirs and theirs[name] != what:
                    raise UserError(
                        f"{folder}: {kind} {name} has changed since it was tested there{other}"
                    )


class ResultsFolder:
    """Episodes of many methods in many scenarios under ``path``; made by ``claim``."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def family(self) -> Family:
        """Whose episodes it holds: the bench's where nothing says otherwise."""
        place = self.path / IDENTITY
        return Family(Identity.read(place).family) if place.exists() else Family.BENCH

    def claim(self, wanted: Identity) -> None:
        """Make the folder, or see that what it holds goes together with ``wanted``.

        Raises UserError where another bench, seed or other weights were tested.
        """
        place = self.path / IDENTITY
        if not place.exists():
            try:
                self.path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise UserError(f"{self.path}: cannot be made ({error.strerror})") from None
            wanted.write(place)
            return
        kept = Identity.read(place)
        kept.check(self.path, wanted)
        kept.scenarios.update(wanted.scenarios)
        kept.changes.update(wanted.changes)
        kept.methods.update(wanted.methods)
        kept.write(place)

    def locked(self) -> AbstractContextManager[object]:
        """Hold the folder against others who would test there; raises UserError where it is held.

        Two that fill one folder would run the same episodes and write over each other's.
        """
        return held(self.path, "a test", "wait for it or choose another --name")

    def file(self, method: str, scenario: str) -> Path:
        """The episodes of ``method`` in ``scenario``."""
        return self.path / f"{method}-{scenario}.csv"

    def packed(self, method: str, scenario: str) -> Path:
        """The same, compressed; counts where there is no ``file``."""
        return self.path / f"{method}-{scenario}.csv.xz"

    def records(self, method: str, scenario: str) -> dict[int, EpisodeRecord]:
        """Episodes by number. A last line that was cut off is left out.

        Raises UserError for a file that is damaged elsewhere.
        """
        path, packed = self.file(method, scenario), self.packed(method, scenario)
        if not path.exists():
            path = packed
        if not path.exists():
            return {}
        family = self.family
        try:
            text = (_unpacked(path) if path == packed else path.read_bytes()).decode()
            rows = csv.DictReader(text[: text.rfind("\n") + 1].splitlines())
            return {int(row["episode"]): _record(row, family) for row in rows}
        except (KeyError, ValueError, TypeError, UserError) as error:
            raise UserError(f"{path}: is damaged ({error}); delete it to test anew") from None

    def keep(self, method: str, scenario: str, records: Iterable[EpisodeRecord]) -> None:
        """Begin the file again with ``records`` only, in order of their episodes."""
        write_whole(self.file(method, scenario), _whole(records))

    def add(self, method: str, scenario: str, *records: EpisodeRecord) -> None:
        """Append episodes, all at once."""
        with self.file(method, scenario).open("a", newline="", encoding="utf-8") as file:
            file.write(_text(map(_row, records)))

    def pack(self, method: str, scenario: str, records: Iterable[EpisodeRecord]) -> None:
        """Write ``records`` compressed, in order of their episodes: same episodes, same bytes."""
        packed = lzma.compress(_whole(records).encode(), preset=9 | lzma.PRESET_EXTREME)
        write_whole(self.packed(method, scenario), packed)

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write ``summary.json`` whole or not at all."""
        write_whole(self.path / SUMMARY, json.dumps(summary, indent=1) + "\n")


def _row(record: EpisodeRecord) -> list[Any]:
    data = record.to_dict()
    data |= data.pop("reward_parts")
    return [episode_of(record.world), *(data[name] for name in COLUMNS[1:])]


def _record(row: dict[str, str], family: Family) -> EpisodeRecord:
    if None in row or None in row.values():
        raise ValueError("a row has other columns than the first line")
    floats = COLUMNS[3 : -len(REWARD_PARTS)]
    return EpisodeRecord.from_dict(
        {
            "world": family.world(int(row["episode"])),
            "episode": 0,
            "outcome": row["outcome"],
            "steps": int(row["steps"]),
            **{name: float(row[name]) for name in floats},
            "reward_parts": {name: float(row[name]) for name in REWARD_PARTS},
        }
    )


def _whole(records: Iterable[EpisodeRecord]) -> str:
    """A file's text: its head, and rows in order of their episodes."""
    return _text([COLUMNS, *map(_row, sorted(records, key=lambda record: record.world))])


def _text(rows: Iterable[Iterable[Any]]) -> str:
    # repr: a float is read back as it was.
    lines = (",".join(repr(v) if isinstance(v, float) else str(v) for v in row) for row in rows)
    return "".join(f"{line}\n" for line in lines)


def _unpacked(path: Path) -> bytes:
    try:
        return lzma.decompress(path.read_bytes())
    except (lzma.LZMAError, EOFError) as error:
        raise ValueError(str(error)) from None


def write_whole(path: Path, content: str | bytes) -> None:
    """Write ``content`` to ``path`` whole or not at all; raises UserError where it cannot be."""
    temporary = path.with_suffix(path.suffix + ".partial")
    try:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
        temporary.replace(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror})") from None
