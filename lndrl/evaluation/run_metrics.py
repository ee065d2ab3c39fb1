"""Reading a run's ``metrics.jsonl``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lndrl.errors import UserError


def read_metrics(path: Path | str) -> list[dict[str, Any]]:
    """Rows of updates of a ``metrics.jsonl``, oldest first.

    Those cut short (a killed run, a full disk) are left out, and those of validation. Raises
    UserError where the file is missing, empty or not of such rows.
    """
    path = Path(path)
    try:
        lines = path.read_text("utf-8").splitlines()
    except FileNotFoundError:
        raise UserError(f"{path}: no such file; a run writes it after its first update") from None
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({error})") from None
    rows = []
    for number, line in enumerate(lines, 1):
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            if number == len(lines):
                break
            if line.startswith("{"):
                continue
            raise UserError(f"{path}, line {number}: not a JSON object") from None
        if not isinstance(row, dict):
            raise UserError(f"{path}, line {number}: not a JSON object")
        if "validation" not in row:
            rows.append(row)
    if not rows:
        raise UserError(f"{path}: holds no rows; a run writes one after each update")
    return rows
