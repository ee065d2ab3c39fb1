"""The model card of the shipped policy: its figures as JSON, and the tables that are made of them.

The page has blocks between ``<!-- lndrl ship: NAME -->`` and ``<!-- end -->`` that are rewritten;
all else of it is written by hand.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, flatten, load_config
from lndrl.errors import UserError
from lndrl.evaluation.hazard import Hazard
from lndrl.policy import driven_at
from lndrl.wilson import wilson_interval

CARD, ROBOT_CARD = "model-card", "model-card-robot"
"""Names of the pages and of the JSON files beside them."""
_BLOCK = re.compile(r"(<!-- lndrl ship: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_ELSEWHERE = ("scenario.", "actor.", "transport.")
"""Keys that do not say how it learned, or fill a page; the place is named."""
_LONGEST = 60


def docs_folder() -> Path:
    """Where the card lies; raises UserError outside of a checkout, where there is none."""
    folder = REPOSITORY_CONFIGS.parent / "docs"
    page = folder / f"{CARD}.md"
    if not page.is_file():
        raise UserError(f"{page}: no such file; lndrl ship works in a checkout of lndrl")
    return folder


@dataclass(frozen=True)
class Card:
    """What is known of a shipped policy: plain types, as in ``model-card.json``."""

    weights: dict[str, Any] = field(default_factory=dict)
    trained: dict[str, Any] = field(default_factory=dict)
    half_precision: dict[str, Any] = field(default_factory=dict)
    results: list[dict[str, Any]] = field(default_factory=list)

    @classmethod
    def read(cls, folder: Path, stem: str = CARD) -> Card:
        """The card in ``folder``; an empty one where there is none. Raises UserError."""
        file = folder / f"{stem}.json"
        try:
            return cls(**json.loads(file.read_text("utf-8")))
        except FileNotFoundError:
            return cls()
        except (OSError, ValueError, TypeError) as error:
            raise UserError(f"{file}: not the data of a model card ({error})") from None

    def write(self, folder: Path, stem: str = CARD) -> None:
        """Write data and page into ``folder``; raises UserError where the disk refuses."""
        page = folder / f"{stem}.md"
        try:
            text = render(page.read_text("utf-8"), self)
            (folder / f"{stem}.json").write_text(json.dumps(asdict(self), indent=1) + "\n", "utf-8")
            page.write_text(text, "utf-8")
        except OSError as error:
            raise UserError(f"{folder}: cannot be written ({error.strerror})") from None


def weights_facts(blob: bytes, parameters: int) -> dict[str, Any]:
    """What is said of the file itself."""
    return {
        "sha256": hashlib.sha256(blob).hexdigest(),
        "bytes": len(blob),
        "precision": "float16",
        "parameters": parameters,
        "temperature": driven_at(blob),
    }


def training_facts(config: RunConfig, metadata: Mapping[str, str]) -> dict[str, Any]:
    """What is said of how it was trained: steps, place, and what lndrl.yaml has otherwise."""
    usual = flatten(load_config(REPOSITORY_CONFIGS / "lndrl.yaml").model_dump(mode="json"))
    own = flatten(config.model_dump(mode="json"))
    changed = {
        key: value
        for key, value in own.items()
        if usual.get(key) != value and not key.startswith(_ELSEWHERE)
    }
    return {
        "steps": int(metadata.get("lndrl.steps", 0)),
        "updates": int(metadata.get("lndrl.version", 0)),
        "seed": config.seed,
        "scenario": config.scenario.name,
        "config_hash": config.content_hash(),
        "changed": changed,
    }


def render(page: str, card: Card) -> str:
    """``page`` with its blocks filled from ``card``; raises UserError for a block of no name."""

    def block(match: re.Match[str]) -> str:
        name = match[2]
        if name not in _BLOCKS:
            raise UserError(f"block {name} is none of {', '.join(_BLOCKS)}")
        return f"{match[1]}{_BLOCKS[name](card)}\n{match[3]}"

    return _BLOCK.sub(block, page)


def _weights(card: Card) -> str:
    if not card.weights:
        return "Nothing is known yet."
    w, t = card.weights, card.trained
    norm = " with a layer norm in its trunk" if t["changed"].get("network.layer_norm") else ""
    changed = "; ".join(f"`{key}: {_short(value)}`" for key, value in t["changed"].items())
    return "\n".join(
        (
            "| | |",
            "|---|---|",
            f"| file | {w['bytes']:,} bytes, SHA-256 `{w['sha256'][:16]}…` |",
            f"| network | the paper's{norm}, {w['parameters']:,} parameters, kept as "
            f"{w['precision']} |",
            f"| trained in, last | {t['scenario']}, {t['steps']:,} control steps, {t['updates']:,} "
            f"updates, seed {t['seed']} |",
            f"| sampled at temperature | {w.get('temperature', 1.0):g} |",
            f"| configuration | `{t['config_hash']}` |",
            f"| other than in `lndrl.yaml` | {changed or 'nothing'} |",
        )
    )


def _precision(card: Card) -> str:
    if not card.half_precision:
        return "Nothing is known yet."
    h = card.half_precision
    one, two = h["arrived"]
    return "\n".join(
        (
            "| half precision against single | |",
            "|---|---|",
            f"| observations that it met in the five places | {h['observations']:,} |",
            f"| largest difference of log-probabilities | {h['greatest']:.4f} |",
            f"| the same, actions of probability 0.01 and more | {h['greatest_likely']:.4f} |",
            f"| greedy decisions that are others | {100 * h['greedy_changed']:.3f} % |",
            "| sampled decisions that are others, with the same noise | "
            f"{100 * h['sampled_changed']:.3f} % |",
            f"| the same {h['episodes']:,} episodes, arrived | {one:,} in single, {two:,} in half "
            f"(p {h['p']:.2f}) |",
            f"| of them ended otherwise | {h['other_outcomes']:,} |",
        )
    )


def _results(card: Card) -> str:
    if not card.results:
        return "Nothing is known yet."
    lines = [
        "| place | shield | arrived | collided | lost | stuck | lost per 1,000 steps | reach time "
        "| vetoed | episodes |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for shield in (False, True):
        rows = [row for row in card.results if row["shield"] is shield]
        lines += [_row(row, row["scenario"]) for row in rows]
        if len(rows) > 1:
            lines.append(_row(_pooled(rows), "**all**"))
    return "\n".join(lines)


def _pooled(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The sums of ``rows``; the reach time is the mean over who arrived."""
    summed = ("episodes", "arrival", "collision", "lost", "stuck", "steps")
    total = {name: sum(row[name] for row in rows) for name in summed}
    total["vetoes"] = sum(row["vetoes"] for row in rows) if rows[0]["shield"] else None
    times = sum(row["arrival"] * (row["reach_time"] or 0.0) for row in rows)
    total["reach_time"] = times / total["arrival"] if total["arrival"] else None
    return {**total, "shield": rows[0]["shield"]}


def _row(row: Mapping[str, Any], name: str) -> str:
    def rate(key: str) -> str:
        low, high = wilson_interval(row[key], row["episodes"])
        return f"{row[key] / row['episodes']:.3f} ({low:.3f}–{high:.3f})"

    hazard = Hazard(row["lost"], row["steps"]).value
    cells = [
        name,
        "yes" if row["shield"] else "no",
        *(rate(key) for key in ("arrival", "collision", "lost", "stuck")),
        f"{hazard:.2f}",
        "–" if row["reach_time"] is None else f"{row['reach_time']:.1f} s",
        "–" if row["vetoes"] is None else f"{100 * row['vetoes'] / max(row['steps'], 1):.1f} %",
        f"{row['episodes']:,}",
    ]
    return f"| {' | '.join(cells)} |"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


_BLOCKS: dict[str, Callable[[Card], str]] = {
    "weights": _weights,
    "precision": _precision,
    "results": _results,
}
