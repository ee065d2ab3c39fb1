"""A run in Weights & Biases: online after ``wandb login``, or a folder with WANDB_MODE=offline.

A resumed run goes on as the same one there, because its id is the run's own. What was sent is noted
in the run's folder, beside what W&B keeps there. Nothing of the machine, its user, its code or its
command lines is sent.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from lndrl.view.run_rows import scalars_of
from lndrl.view.tracking.feed import Row, made_at
from lndrl.view.tracking.publish import RunFacts, TrackerError, plain, quiet_modules

_LONGEST_ID = 128
T = TypeVar("T")


class WandbTracker:
    """See ``Tracker``. The project is WANDB_PROJECT, else ``lndrl``."""

    def __init__(self, facts: RunFacts) -> None:
        os.environ.setdefault("WANDB_ERROR_REPORTING", "false")
        quiet_modules("wandb")
        self._note = facts.folder / "wandb" / "lndrl.json"
        self._id = re.sub(r"[^A-Za-z0-9_.-]", "-", facts.run_id)[-_LONGEST_ID:]
        self._run = _try(lambda: self._begun(facts))
        project = os.environ.get("WANDB_PROJECT") or "lndrl"
        place = f"offline in {self._note.parent}" if self._run.settings._offline else "online"
        self.where = f"Weights & Biases, {place}, project {project}, run {facts.name}"

    def sent(self) -> float:
        """See ``Tracker``."""
        try:
            note = json.loads(self._note.read_text("utf-8"))
            return float(note["unix"]) if note["run_id"] == self._id else 0.0
        except (OSError, ValueError, KeyError, TypeError):
            return 0.0

    def send(self, rows: Sequence[Row]) -> None:
        """See ``Tracker``."""

        def work() -> None:
            for row in rows:
                steps = row["validation"]["steps"] if "validation" in row else row["steps"]
                self._run.log({**scalars_of(row), "steps": steps})
            # Not whole or nothing: without it rows are sent once more, which does no harm.
            note = {"run_id": self._id, "unix": made_at(rows[-1])}
            self._note.write_text(json.dumps(note) + "\n", encoding="utf-8")

        _try(work)

    def finish(self, ended: bool) -> None:
        """See ``Tracker``."""
        _try(lambda: self._run.finish(exit_code=0))

    def _begun(self, facts: RunFacts) -> Any:
        import wandb

        settings = wandb.Settings(
            console="off",
            disable_code=True,
            disable_git=True,
            save_code=False,
            silent=True,
            x_disable_machine_info=True,
            x_disable_meta=True,
            x_disable_stats=True,
        )
        run = wandb.init(
            project=os.environ.get("WANDB_PROJECT") or "lndrl",
            id=self._id,
            name=facts.name,
            resume="allow",
            dir=str(facts.folder),
            config={**facts.config, "lndrl_version": facts.version},
            allow_val_change=True,
            settings=settings,
        )
        # What a resumed run does again comes later, under steps that were there before; W&B's own
        # axis never goes back.
        run.define_metric("steps")
        run.define_metric("*", step_metric="steps")
        return run


def _try(work: Callable[[], T]) -> T:
    """``work``'s result; whatever it raises as a TrackerError."""
    try:
        return work()
    except Exception as error:
        raise TrackerError(f"Weights & Biases: {plain(error)}") from None
