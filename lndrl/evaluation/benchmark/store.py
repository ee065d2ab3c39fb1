"""A benchmark's folder: one row per episode, and what the rows are worth.

``benchmark.json`` says which bench, seed and planners the rows belong to; ``METHOD-SCENARIO.csv``
has the episodes of a method in a scenario, appended as they end; ``summary.json`` is written when
all are there. Rows of another bench or other weights are refused, not mixed.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lndrl.errors import UserError
from lndrl.evaluation.episodes import TEST_WORLD
from lndrl.machine.lock import held
from lndrl.navigation import EpisodeRecord
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
    localization, ``changes`` scenarios to what was set in them (key=value).
    """

    seed: int
    program_version: str
    scenarios: dict[str, str] = field(default_factory=dict)
    methods: dict[str, dict[str, str]] = field(default_factory=dict)
    changes: dict[str, list[str]] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> Identity:
        """Raises UserError naming the file."""
        try:
            return cls(**json.loads(path.read_text("utf-8")))
        except FileNotFoundError:
            raise UserError(f"{path.parent}: holds no results of lndrl benchmark") from None
        except (OSError, ValueError, TypeError) as error:
            raise UserError(f"{path}: cannot be read ({error})") from None

    def write(self, path: Path) -> None:
        """Raises UserError where the disk refuses."""
        _replace(path, json.dumps(vars(self), indent=1) + "\n")


class ResultsFolder:
    """Episodes of many methods in many scenarios under ``path``; made by ``claim``."""

    def __init__(self, path: Path) -> None:
        self.path = path

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
        other = "; delete the folder or choose another --name"
        if kept.seed != wanted.seed:
            raise UserError(
                f"{self.path} was filled under seed {kept.seed}, not {wanted.seed}{other}"
            )
        for kind, ours, theirs in (
            ("scenario", wanted.scenarios, kept.scenarios),
            ("method", wanted.methods, kept.methods),
        ):
            for name, what in ours.items():
                if name in theirs and theirs[name] != what:
                    raise UserError(
                        f"{self.path}: {kind} {name} has changed since it was tested there{other}"
                    )
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

    def records(self, method: str, scenario: str) -> dict[int, EpisodeRecord]:
        """Episodes by number. A last line that was cut off is left out.

        Raises UserError for a file that is damaged elsewhere.
        """
        path = self.file(method, scenario)
        if not path.exists():
            return {}
        text = path.read_text("utf-8")
        rows = list(csv.DictReader(text[: text.rfind("\n") + 1].splitlines()))
        try:
            return {record.world - TEST_WORLD: record for record in map(_record, rows)}
        except (KeyError, ValueError, TypeError) as error:
            raise UserError(f"{path}: is damaged ({error}); delete it to test anew") from None

    def keep(self, method: str, scenario: str, records: Iterable[EpisodeRecord]) -> None:
        """Begin the file again with ``records`` only, in order of their episodes."""
        ordered = sorted(records, key=lambda record: record.world)
        _replace(self.file(method, scenario), _text([COLUMNS, *map(_row, ordered)]))

    def add(self, method: str, scenario: str, record: EpisodeRecord) -> None:
        """Append one episode."""
        with self.file(method, scenario).open("a", newline="", encoding="utf-8") as file:
            file.write(_text([_row(record)]))

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write ``summary.json`` whole or not at all."""
        _replace(self.path / SUMMARY, json.dumps(summary, indent=1) + "\n")


def _row(record: EpisodeRecord) -> list[Any]:
    data = record.to_dict()
    data |= data.pop("reward_parts")
    return [record.world - TEST_WORLD, *(data[name] for name in COLUMNS[1:])]


def _record(row: dict[str, str]) -> EpisodeRecord:
    if None in row or None in row.values():
        raise ValueError("a row has other columns than the first line")
    floats = COLUMNS[3 : -len(REWARD_PARTS)]
    return EpisodeRecord.from_dict(
        {
            "world": TEST_WORLD + int(row["episode"]),
            "episode": 0,
            "outcome": row["outcome"],
            "steps": int(row["steps"]),
            **{name: float(row[name]) for name in floats},
            "reward_parts": {name: float(row[name]) for name in REWARD_PARTS},
        }
    )


def _text(rows: Iterable[Iterable[Any]]) -> str:
    # repr: a float is read back as it was.
    lines = (",".join(repr(v) if isinstance(v, float) else str(v) for v in row) for row in rows)
    return "".join(f"{line}\n" for line in lines)


def _replace(path: Path, text: str) -> None:
    temporary = path.with_suffix(path.suffix + ".partial")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror})") from None
