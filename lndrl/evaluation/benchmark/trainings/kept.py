"""What is handed on of how a policy was trained: seed, time, machine and its learning curve.

A run folder is of some hundred megabytes and stays where it is. ``RUN-POLICY-training.jsonl.xz``
beside packed episodes has what a table's reader asks for in fifteen kilobytes: a first line that
says which run and policy it was, then the rows of its ``metrics.jsonl`` without what only its
trainer needs.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from lndrl.config import load_config
from lndrl.curve import curve_in, read_curve
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.spec import DIGITS
from lndrl.evaluation.benchmark.store import write_whole
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.models import MOST, Model, NonNegative, Probability, validate
from lndrl.numbering import BEST, checkpoints_in, step_of
from lndrl.policy import POLICY_FILE
from lndrl.transport.messages import COUNTS

_IN_NAME = 8  # of these
_SUFFIX = "-training.jsonl.xz"
_HEAD = "training"
_OF_VALIDATION = ("version", "steps", "elapsed", "unix", "under")
_MACHINE = re.compile(r"^\S+ \S+ machine +(?P<words>.+)$", re.MULTILINE)
_UNREADABLE = (OSError, ValueError, OverflowError, RecursionError, KeyError, TypeError)

Row = Mapping[str, Any]
Whole = Annotated[int, Field(ge=0, le=MOST)]


class _Facts(Model):
    """All of ``Training`` but its curve."""

    run: str
    policy: Annotated[str, Field(pattern=f"^[0-9a-f]{{{DIGITS}}}$")]
    tested: Whole
    seed: Whole
    config: str
    program: str
    machine: str
    steps: Whole
    seconds: NonNegative


class _Episodes(Model):
    count: Whole
    arrived: Probability | None = None
    collided: Probability | None = None
    lost: Probability | None = None
    timeout: Probability | None = None
    mean_return: float | None = None
    mean_time: NonNegative | None = None


class _Time(Model):
    elapsed: NonNegative


class _Update(Model):
    """What is kept of an update's row."""

    update: Whole
    steps: Whole
    episodes: _Episodes
    time: _Time


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
    def short(self) -> str:
        """The policy's first digits, enough to tell those of a run apart."""
        return self.policy[:_IN_NAME]

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

    None where there is no such folder or policy: it has been trained on or anew since. Raises
    UserError for a folder whose records are damaged or not for us to read.
    """
    try:
        tested = _step_of(folder, policy)
        return None if tested is None else _training(folder, policy, tested)
    except _UNREADABLE as error:
        raise UserError(
            f"{folder}: how it was trained cannot be read ({type(error).__name__}: {error})"
        ) from None


def _training(folder: Path, policy: str, tested: int) -> Training:
    metrics = folder / "metrics.jsonl"
    rows = [_checked(_thin(row), str(metrics)) for row in read_metrics(metrics)]
    curve = [
        {**{k: row[k] for k in _OF_VALIDATION if k in row}, **_counts(row)}
        for row in read_curve(metrics)
    ]
    config = load_config(folder / "config.yaml")
    facts = _Facts(
        run=folder.name,
        policy=policy,
        tested=tested,
        seed=config.seed,
        config=config.content_hash(),
        program=str(json.loads((folder / "run.json").read_text("utf-8"))["version"]),
        machine=_machine(folder),
        steps=rows[-1]["steps"],
        seconds=rows[-1]["time"]["elapsed"],
    )
    return Training(**facts.model_dump(), rows=rows, curve=curve)


def training_file(folder: Path, run: str, policy: str) -> Path:
    """Where ``folder`` keeps the training of the ``policy`` of ``run``."""
    return folder / f"{run}-{policy[:_IN_NAME]}{_SUFFIX}"


def write_training(folder: Path, training: Training) -> Path:
    """Write it into ``folder``: same training, same bytes. Raises UserError."""
    path = training_file(folder, training.run, training.policy)
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
        facts = validate(_Facts, json.loads(head)[_HEAD], "its first line")
        found = [row for row in map(json.loads, lines) if "validation" not in row]
        rows = [_checked(row, "an update") for row in found]
        if not rows:
            raise ValueError("it has no update")
    except (UserError, lzma.LZMAError, EOFError, *_UNREADABLE) as error:
        raise UserError(
            f"{path}: is damaged ({error}); delete it to see the results without"
        ) from None
    return Training(**facts.model_dump(), rows=rows, curve=curve_in(lines))


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
            if place.name != BEST:
                return step_of(place)
            return int(json.loads((place / "validation.json").read_text("utf-8"))["steps"])
    return None


def _checked(row: Any, where: str) -> dict[str, Any]:
    return validate(_Update, row, where).model_dump()


def _thin(row: Row) -> dict[str, Any]:
    episodes = row["episodes"]
    return {
        "update": row["update"],
        "steps": row["steps"],
        "episodes": {name: episodes[name] for name in _Episodes.model_fields if name in episodes},
        "time": {"elapsed": round(row["time"]["elapsed"], 1)},
    }


def _counts(row: Row) -> dict[str, dict[str, int]]:
    return {kind: {name: row[kind][name] for name in COUNTS} for kind in ("sampled", "greedy")}


def _machine(folder: Path) -> str:
    """Those that the learner ran on, one after the other, as it said in its event log."""
    found: dict[str, None] = {}
    for name in ("events.log.1", "events.log"):
        if (folder / name).is_file():
            text = (folder / name).read_text("utf-8", "replace")
            found |= dict.fromkeys(each["words"] for each in _MACHINE.finditer(text))
    return "; then ".join(found)
