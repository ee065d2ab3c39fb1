"""The whole of ``lndrl bench gpu``: its parts, and the file that holds what is known so far."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from learner.run.folder import write_whole
from lndrl.bench.gpu import acting, card, checks, compiling, learning, whole
from lndrl.bench.gpu.apart import apart
from lndrl.bench.gpu.parts import DONE, FAILED, Outcomes, Part, Tell, measure_parts
from lndrl.bench.gpu.plan import Plan
from lndrl.bench.report import machine
from lndrl.errors import UserError
from lndrl.policy import resolve_device


def check_device(plan: Plan) -> None:
    """Raise UserError where the device is not there."""
    try:
        resolve_device(plan.device)
    except UserError as error:
        why = str(error).partition(": ")[2].partition(";")[0]
        raise UserError(
            f"bench gpu: {why}; --rehearse runs the same script in small on the CPU"
        ) from None


def parts_of(plan: Plan) -> list[Part]:
    """All parts in their order: what is least likely to fail, and quickest, first.

    Shares are of eight minutes; what compiling leaves (kernels may be kept) is for the others.
    """

    def alone(work: Callable[[Tell, Plan], None], tell: Tell, deadline: float) -> None:
        apart(tell, deadline, (work, (plan,)))

    def part(
        name: str,
        share: float,
        least: float,
        work: Callable[[Tell, float], None],
        borrows: bool = False,
    ) -> Part:
        return Part(name, share, plan.least * least, work, borrows)

    return [
        part("card", 20.0, 5.0, partial(alone, card.measure)),
        part("kernels", 120.0, 20.0, partial(compiling.measure, plan=plan), borrows=True),
        part("tests", 60.0, 20.0, partial(checks.measure, plan=plan)),
        part("policy", 40.0, 20.0, partial(alone, acting.measure)),
        part("learner", 50.0, 20.0, partial(alone, learning.measure)),
        part("train", 110.0, 60.0, partial(whole.rates, plan=plan)),
        part("arrivals", 80.0, 60.0, partial(whole.arrivals, plan=plan)),
    ]


def measure(plan: Plan, minutes: float, out: Path, say: Callable[[str], object]) -> dict[str, Any]:
    """Measure all parts in ``minutes``; ``out`` holds ``content`` of what is known, at any time.

    Returns the same. Raises UserError where ``out`` cannot be written.
    """
    facts = {
        "rehearsal": plan.is_rehearsal,
        "began": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds_allowed": 60.0 * minutes,
        "plan": asdict(plan),
        "machine": machine(),
    }
    began = time.monotonic()

    def keep(outcomes: Outcomes) -> None:
        made = content(facts, outcomes, time.monotonic() - began)
        try:
            write_whole(out, json.dumps(made, indent=2) + "\n")
        except OSError as error:
            raise UserError(f"--out {out}: cannot be written ({error.strerror})") from None

    outcomes = measure_parts(parts_of(plan), 60.0 * minutes, keep, say)
    return content(facts, outcomes, time.monotonic() - began)


def content(facts: dict[str, Any], outcomes: Outcomes, seconds: float) -> dict[str, Any]:
    """What the file holds: ``facts``, and of each part its ``state``, ``seconds`` and figures."""
    parts = {name: asdict(outcome) for name, outcome in outcomes.items()}
    complete = all(outcome.state == DONE for outcome in outcomes.values())
    return {**facts, "seconds": seconds, "complete": complete, "parts": parts}


def has_failed(content: dict[str, Any]) -> bool:
    """Whether a part failed; to be skipped or short of time is no failure."""
    return any(part["state"] == FAILED for part in content["parts"].values())
