"""Healthy ranges of PPO's numbers, and a sentence for each that is outside.

Rules of thumb from the practice of CleanRL, Stable-Baselines3 and rsl_rl, not laws: they colour
a number, they never stop a run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from lndrl.transport.status import IMITATION, Status
from lndrl.view.text import number

LABELS = {
    "entropy": "entropy",
    "kl": "KL",
    "clip_fraction": "clip fraction",
    "explained_variance": "explained var",
    "learning_rate": "learning rate",
    "policy_loss": "policy loss",
    "value_loss": "value loss",
    "gradient_norm_policy": "grad policy",
    "gradient_norm_value": "grad value",
    "importance_max": "importance",
    "teacher_kl": "KL of teacher",
    "teacher_agreement": "as teacher",
}
"""Names of the numbers as the dashboard prints them, in its order."""

SHORT_LABELS = {
    "entropy": "entropy",
    "kl": "KL",
    "clip_fraction": "clipped",
    "explained_variance": "expl.var",
    "learning_rate": "rate",
    "policy_loss": "π loss",
    "value_loss": "V loss",
    "gradient_norm_policy": "π grad",
    "gradient_norm_value": "V grad",
    "importance_max": "ratio",
    "teacher_kl": "KL teach",
    "teacher_agreement": "as teach",
}
"""The same names where a column is narrow."""

OF_A_TEACHER = ("teacher_kl", "teacher_agreement")
"""Numbers that only a run with a teacher has."""

SETTLED = 10
"""Updates until a value network may be expected to explain anything."""


@dataclass(frozen=True)
class Limit:
    """A number is worth a warning beyond ``warn`` and severe beyond ``severe``."""

    warn: float
    severe: float
    meaning: str
    above: bool = True


LIMITS = {
    "entropy": Limit(0.3, 0.05, "the policy hardly explores any more", above=False),
    "kl": Limit(0.03, 0.1, "the policy jumps; fewer epochs or a lower rate help"),
    "clip_fraction": Limit(0.3, 0.5, "most samples are clipped; updates are too large"),
    "explained_variance": Limit(0.1, -0.5, "values do not predict the returns", above=False),
    "gradient_norm_policy": Limit(20.0, 200.0, "gradients are far above the clip"),
    "gradient_norm_value": Limit(50.0, 500.0, "gradients are far above the clip"),
    "importance_max": Limit(9.99, math.inf, "stale data: the correction hits its cap"),
}


@dataclass(frozen=True)
class Finding:
    """One number out of its range."""

    key: str
    severe: bool
    sentence: str


def findings(status: Status) -> list[Finding]:
    """Numbers of the newest update out of range, worst first; not finite is worst of all."""
    found = []
    for key, label in LABELS.items():
        value = getattr(status.ppo, key)
        if value is None:
            continue
        if not math.isfinite(value):
            found.append(
                Finding(key, True, f"{label} is {number(value)}: training has broken down")
            )
            continue
        limit = LIMITS.get(key)
        if limit is None or (key == "explained_variance" and status.updates < SETTLED):
            continue
        if key == "entropy" and status.phase == IMITATION:
            continue  # whoever imitates is to become as sure as the teacher
        sign = 1.0 if limit.above else -1.0
        if sign * (value - limit.warn) > 0:
            severe = sign * (value - limit.severe) > 0
            bound = f"{'above' if limit.above else 'below'} {limit.warn:g}"
            found.append(Finding(key, severe, f"{label} {bound}: {limit.meaning}"))

    def rank(finding: Finding) -> tuple[bool, bool]:
        return math.isfinite(getattr(status.ppo, finding.key)), not finding.severe

    return sorted(found, key=rank)
