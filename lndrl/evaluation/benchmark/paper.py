"""The paper's Table II: means over its five scenarios with 500 episodes each (PAPER)."""

from __future__ import annotations

from dataclasses import dataclass

EPISODES = 500
"""Per method and scenario."""
SCENARIOS = 5


@dataclass(frozen=True)
class PaperRow:
    """One method's published figures; s, m, m, rad, and the sum of variances in m² and rad²."""

    label: str
    ar: float
    cr: float
    lr: float
    sr: float
    reach_time: float
    distance: float
    position_error: float
    angle_error: float
    variance_sum: float


PAPER = {
    "dwa": PaperRow("DWA", 0.631, 0.322, 0.035, 0.012, 23.82, 11.19, 0.3083, 0.1257, 0.5144),
    "drl_laser": PaperRow(
        "DRL_laser", 0.542, 0.395, 0.057, 0.006, 29.88, 13.09, 0.3265, 0.1928, 0.3018
    ),
    "drl_laser_ped": PaperRow(
        "DRL_laser+ped", 0.641, 0.153, 0.054, 0.152, 30.76, 16.18, 0.3261, 0.2697, 0.2951
    ),
    "lndrl": PaperRow("LNDRL", 0.892, 0.104, 0.003, 0.001, 22.86, 12.21, 0.3071, 0.1887, 0.1062),
    "no_variance": PaperRow(
        "-variance", 0.790, 0.188, 0.021, 0.001, 23.03, 12.49, 0.3072, 0.2338, 0.2301
    ),
    "no_reward": PaperRow(
        "-reward", 0.743, 0.227, 0.030, 0.000, 23.54, 12.69, 0.3725, 0.1873, 0.3153
    ),
}
"""By the names of ``configs/benchmark.yaml``."""

ALIKE = {f"{name}-alone": name for name in ("lndrl", "no_variance", "no_reward", "drl_laser_ped")}
"""Rows of the bench that stand for one of the paper's as well: by reward alone, as it trains."""


def published(method: str) -> PaperRow | None:
    """The paper's row that stands beside ``method``; None where it has none."""
    return PAPER.get(ALIKE.get(method, method))
