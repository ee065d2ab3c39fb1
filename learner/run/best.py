"""``checkpoints/best``: the policy that did best in validation, and what was validated.

No checkpoint: there are no optimizers, training never goes on from it, and ``keep_checkpoints``
does not count it. Whole or absent as they are.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors

from learner.run.checkpoint import write_folder
from lndrl.config import RunConfig
from lndrl.numbering import BEST
from lndrl.policy import POLICY_FILE, policy_metadata
from lndrl.policy.weights import VALIDATED_KEY

FACTS_FILE = "validation.json"
_NEEDED = {
    **{"version": int, "steps": int, "unix": float, "score": float},
    **{"under": str, "digest": str, "sampled": dict, "greedy": dict},
}


def save_best(folder: Path, config: RunConfig, weights: bytes, facts: dict[str, Any]) -> None:
    """Put the policy ``weights`` and what was validated of it in the place of ``folder/best``.

    ``facts`` are a row of the curve and its ``score``. Raises OSError when the disk refuses; what
    was there before stays.
    """
    metadata = policy_metadata(config, facts["version"], facts["steps"])
    metadata[VALIDATED_KEY] = json.dumps(facts["sampled"])
    policy = save_tensors(load_tensors(weights), metadata)
    facts = {**facts, "digest": hashlib.sha256(policy).hexdigest()}
    text = json.dumps(facts, indent=1) + "\n"
    write_folder(folder / BEST, {POLICY_FILE: policy, FACTS_FILE: text.encode()})


def read_best(folder: Path) -> dict[str, Any] | None:
    """What ``save_best`` noted; None where there is none. Raises ValueError for a damaged one."""
    best = folder / BEST
    if not best.exists():
        return None
    try:
        facts = json.loads((best / FACTS_FILE).read_text("utf-8"))
        if not isinstance(facts, dict):
            raise ValueError(f"{FACTS_FILE} holds no map")
        for name, kind in _NEEDED.items():
            if type(facts.get(name)) is not kind:
                raise ValueError(f"{FACTS_FILE} says no {name}")
        policy = (best / POLICY_FILE).read_bytes()
    except (OSError, RecursionError) as error:
        raise ValueError(str(error)) from None
    if hashlib.sha256(policy).hexdigest() != facts["digest"]:
        raise ValueError(f"{POLICY_FILE} is not what was written")
    return facts


def set_aside_best(folder: Path) -> None:
    """Call it ``abandoned-best``: it is no measure any more for what comes."""
    target = folder / f"abandoned-{BEST}"
    shutil.rmtree(target, ignore_errors=True)
    with suppress(OSError):
        (folder / BEST).rename(target)
