"""What is handed on of how a policy was trained: seed, time, machine and its learning curve.

A run folder is of some hundred megabytes and stays where it is. ``RUN-training.jsonl.xz`` beside
packed episodes has what a table's reader asks for in some tens of kilobytes: a first line that says
which run it was, then the rows of its ``metrics.jsonl`` without what only its trainer needs.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from lndrl.config import load_config
from lndrl.curve import curve_in, read_curve
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.store import write_whole
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.numbering import BEST, checkpoints_in, step_of
from lndrl.policy import POLICY_FILE
from lndrl.transport.messages import COUNTS

DIGITS = 16
"""Of the digest of a policy file, by which episodes know their policy."""
_SUFFIX = "-training.jsonl.xz"
_HEAD = "training"
_OF_EPISODES = ("count", *("arrived", "collided", "lost", "timeout"), *("mean_return", "mean_time"))
_OF_VALIDATION = ("version", "steps", "elapsed", "unix", "under")
_MACHINE = re.compile(r"^\S+ \S+ machine +(?P<words>.+)$", re.MULTILINE)

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Training:
    """How a policy that was tested had been trained.

    ``run``: name of its folder. ``policy``: first digits of the digest of the tested policy file.
    ``tested``: the step of its version. ``config``: hash of the configuration, ``program`` the
    version that trained. ``machine``: the learner's, in words; empty where the run does not say.
    ``steps`` and ``seconds`` of the whole training. ``rows`` and ``curve``: its updates and
    validated versions, as ``metrics.jsonl`` has them but for what is left out.
    """

    run: str
    policy: str
    tested: int
    seed: int
    config: str
    program: str
    machine: str
    steps: int
    seconds: float
    rows: Sequence[Row] = field(repr=False)
    curve: Sequence[Row] = field(repr=False)

    @property
    def validated(self) -> Row | None:
        """Counts of the tested version's validation, with sampled actions; None without one."""
        found = [row["sampled"] for row in self.curve if row["steps"] == self.tested]
        return found[-1] if found else None

    def to_dict(self) -> dict[str, Any]:
        """Plain types, without the curve."""
        whole = asdict(self)
        counts = self.validated
        del whole["rows"], whole["curve"]
        return whole | {"validated": None if counts is None else dict(counts)}


def training_of(folder: Path, policy: str) -> Training | None:
    """Of the run ``folder``, if the policy file with the digits ``policy`` is still in it.

    None where there is no such folder or policy: it has been trained again since. Raises UserError
    for a folder whose records are damaged.
    """
    tested = _step_of(folder, policy)
    if tested is None:
        return None
    config = load_config(folder / "config.yaml")
    try:
        rows = [_thin(row) for row in read_metrics(folder / "metrics.jsonl")]
    except (KeyError, TypeError) as error:
        raise UserError(f"{folder / 'metrics.jsonl'}: a row has no {error}") from None
    curve = [
        {**{k: row[k] for k in _OF_VALIDATION if k in row}, **_counts(row)}
        for row in read_curve(folder / "metrics.jsonl")
    ]
    return Training(
        run=folder.name,
        policy=policy,
        tested=tested,
        seed=config.seed,
        config=config.content_hash(),
        program=_program(folder),
        machine=_machine(folder),
        steps=rows[-1]["steps"],
        seconds=rows[-1]["time"]["elapsed"],
        rows=rows,
        curve=curve,
    )


def training_file(folder: Path, run: str) -> Path:
    """Where ``folder`` keeps the training of ``run``."""
    return folder / f"{run}{_SUFFIX}"


def write_training(folder: Path, training: Training) -> Path:
    """Write it into ``folder``: same training, same bytes. Raises UserError."""
    path = training_file(folder, training.run)
    head = asdict(training)
    rows, curve = head.pop("rows"), head.pop("curve")
    lines = [{_HEAD: head}, *rows, *({"validation": row} for row in curve)]
    text = "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines)
    write_whole(path, lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))
    return path


def read_training(path: Path) -> Training:
    """What ``write_training`` wrote; raises UserError naming a file that is damaged."""
    try:
        head, *lines = lzma.decompress(path.read_bytes()).splitlines()
        rows = [row for row in map(json.loads, lines) if "validation" not in row]
        found = Training(**json.loads(head)[_HEAD], rows=rows, curve=curve_in(lines))
        if not rows:
            raise ValueError("it has no update")
    except (OSError, lzma.LZMAError, EOFError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{path}: is damaged ({error}); pack the results anew") from None
    return found


def kept_trainings(folder: Path) -> list[Training]:
    """All that lie in ``folder``, by name of their run."""
    return [read_training(path) for path in sorted(folder.glob(f"*{_SUFFIX}"))]


def _step_of(folder: Path, policy: str) -> int | None:
    """The step of the version whose file in the run ``folder`` has the digits ``policy``."""
    places = [folder / "checkpoints" / BEST, *reversed(checkpoints_in(folder / "checkpoints"))]
    for place in places:
        file = place / POLICY_FILE
        if not file.is_file():
            continue
        if hashlib.sha256(file.read_bytes()).hexdigest()[:DIGITS] == policy:
            return step_of(place) if place.name != BEST else _validated_at(place)
    return None


def _validated_at(best: Path) -> int:
    try:
        return int(json.loads((best / "validation.json").read_text("utf-8"))["steps"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{best / 'validation.json'}: cannot be read ({error})") from None


def _thin(row: Row) -> dict[str, Any]:
    episodes = row["episodes"]
    return {
        "update": row["update"],
        "steps": int(row["steps"]),
        "episodes": {name: episodes[name] for name in _OF_EPISODES if name in episodes},
        "time": {"elapsed": round(float(row["time"]["elapsed"]), 1)},
    }


def _counts(row: Row) -> dict[str, dict[str, int]]:
    return {kind: {name: row[kind][name] for name in COUNTS} for kind in ("sampled", "greedy")}


def _program(folder: Path) -> str:
    try:
        return str(json.loads((folder / "run.json").read_text("utf-8"))["version"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{folder / 'run.json'}: cannot be read ({error})") from None


def _machine(folder: Path) -> str:
    """Those that the learner ran on, one after the other, as it said in its event log."""
    try:
        text = (folder / "events.log").read_text("utf-8", "replace")
    except OSError:
        return ""
    return "; then ".join(dict.fromkeys(found["words"] for found in _MACHINE.finditer(text)))
