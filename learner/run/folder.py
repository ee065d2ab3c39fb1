"""A run's folder: ``runs/NAME`` with configuration, identity, checkpoints and records."""

from __future__ import annotations

import json
import secrets
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.version import VERSION


@dataclass(frozen=True)
class RunFolder:
    """Where a run lives and what it is called on the network."""

    path: Path
    run_id: str

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
            (path / "checkpoints").mkdir()
            (path / "config.yaml").write_text(config.to_yaml(), encoding="utf-8")
            identity = {"run_id": run_id, "version": VERSION}
            (path / "run.json").write_text(json.dumps(identity) + "\n", encoding="utf-8")
        except FileExistsError:
            raise UserError(f"{path} exists already; use --resume or another --run") from None
        except OSError as error:
            raise UserError(f"{path}: the run folder cannot be made ({error.strerror})") from None
        return cls(path, run_id)

    @classmethod
    def open(cls, path: Path, config: RunConfig) -> RunFolder:
        """Take up an existing run and note the configuration it goes on with."""
        try:
            run_id = str(json.loads((path / "run.json").read_text("utf-8"))["run_id"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UserError(f"{path}: is no run folder of lndrl ({error})") from None
        kept, text = path / "config.yaml", config.to_yaml()
        try:
            # A disk without room does not keep a run from going on as it was.
            if not kept.exists() or kept.read_text("utf-8") != text:
                write_whole(kept, text)
        except OSError as error:
            raise UserError(f"{kept}: cannot be written ({error.strerror})") from None
        return cls(path, run_id)

    def write_summary(self, summary: dict[str, object]) -> None:
        """Write ``summary.json``; raises OSError, and leaves an older one as it was."""
        write_whole(self.path / "summary.json", json.dumps(summary, indent=1) + "\n")


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
