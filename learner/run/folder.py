"""A run's folder: ``runs/NAME`` with configuration, identity, checkpoints and records."""

from __future__ import annotations

import json
import secrets
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.machine.lock import FolderLock, check_free
from lndrl.version import VERSION

_WHOSE, _ADVICE = "a learner", "stop it there, or choose another --run"


@dataclass(frozen=True)
class RunFolder:
    """Where a run lives and what it is called on the network; held until ``release``.

    ``unlocked`` says why nobody is kept out, where a disk or file system does not let it be held.
    """

    path: Path
    run_id: str
    lock: FolderLock | None = None
    unlocked: str = ""

    @property
    def checkpoints(self) -> Path:
        """Folder of the checkpoints."""
        return self.path / "checkpoints"

    @property
    def events(self) -> Path:
        """The event log."""
        return self.path / "events.log"

    @property
    def ledger(self) -> Path:
        """What became of every chunk; see ``learner.intake.ledger``."""
        return self.path / "ledger.jsonl"

    @classmethod
    def create(cls, path: Path, config: RunConfig) -> RunFolder:
        """Make the folder of a new run; raises UserError when it exists or cannot be made."""
        run_id = f"{path.name}-{secrets.token_hex(4)}"
        try:
            path.mkdir(parents=True)
            lock, why = _take(path)
            (path / "checkpoints").mkdir()
            (path / "config.yaml").write_text(config.to_yaml(), encoding="utf-8")
            identity = {"run_id": run_id, "version": VERSION}
            (path / "run.json").write_text(json.dumps(identity) + "\n", encoding="utf-8")
        except FileExistsError:
            raise UserError(f"{path} exists already; use --resume or another --run") from None
        except OSError as error:
            raise UserError(f"{path}: the run folder cannot be made ({error.strerror})") from None
        return cls(path, run_id, lock, why)

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Take up an existing run; raises UserError for none, and for one that is being trained."""
        if not (path / "run.json").is_file():
            raise UserError(f"{path}: is no run folder of lndrl (it has no run.json)")
        lock, why = _take(path)
        try:
            run_id = str(json.loads((path / "run.json").read_text("utf-8"))["run_id"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            if lock is not None:
                lock.release()
            raise UserError(f"{path}: is no run folder of lndrl ({error})") from None
        return cls(path, run_id, lock, why)

    @staticmethod
    def check_free(path: Path) -> None:
        """Raise UserError where a learner works in ``path``, which need not be a run."""
        check_free(path, _WHOSE, _ADVICE)

    def release(self) -> None:
        """Let others go on with the run; can be called twice."""
        if self.lock is not None:
            self.lock.release()

    def write_config(self, config: RunConfig) -> None:
        """Note the configuration that the run goes on with; raises UserError."""
        kept, text = self.path / "config.yaml", config.to_yaml()
        try:
            # A disk without room does not keep a run from going on as it was.
            if not kept.exists() or kept.read_text("utf-8") != text:
                write_whole(kept, text)
        except OSError as error:
            raise UserError(f"{kept}: cannot be written ({error.strerror})") from None

    def write_summary(self, summary: dict[str, object]) -> None:
        """Write ``summary.json``; raises OSError, and leaves an older one as it was."""
        write_whole(self.path / "summary.json", json.dumps(summary, indent=1) + "\n")


def _take(path: Path) -> tuple[FolderLock | None, str]:
    """The lock of a run's folder, or why there is none; raises UserError where it is held."""
    try:
        return FolderLock(path, _WHOSE, _ADVICE), ""
    except OSError as error:
        return None, error.strerror or str(error)


def write_whole(path: Path, text: str) -> None:
    """Write a file whole or not at all; raises OSError."""
    temporary = path.with_name(f".{path.name}.partial")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    except OSError:
        with suppress(OSError):
            temporary.unlink()
        raise
