"""A policy as one function of what a robot measures, made of tensors alone.

The graph that is exported holds everything between the sensors and the log-probabilities: a scan in
metres is quantised as the observation quantises it, people are drawn onto their map by the function
that draws on devices, and variances are clipped, so that whoever drives it scales nothing.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from lndrl.config import RunConfig
from lndrl.config.learning import BUILT_IN
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.policy.inputs import Inputs
from lndrl.policy.networks import Network
from lndrl.policy.raster import draw_on_device

OUTPUT = "log_probabilities"
"""Name of the graph's output: float32 (N, actions)."""
ROWS = "N"
"""Name of the dimension that may have any size: decisions that are made at once."""


def goal_values(config: RunConfig) -> int:
    """How many of the goal's six values are read: 3 where a built-in network has no variances."""
    reads_all = config.network.variances or config.network.policy != BUILT_IN
    return 6 if reads_all else 3


def example_inputs(config: RunConfig, rows: int = 2) -> dict[str, Tensor]:
    """Inputs of the graph by name, in its order, for ``rows`` empty observations.

    A network without a pedestrian map has no ``people`` and no ``count``.
    """
    task = config.task
    made = {"scan": torch.zeros(rows, task.scan_frames * config.world.laser.beams)}
    if config.network.pedestrian_map:
        made["people"] = torch.zeros(rows, task.max_pedestrians, 4)
        made["count"] = torch.zeros(rows, dtype=torch.int64)
    made["goal"] = torch.zeros(rows, goal_values(config))
    return made


class PolicyGraph(nn.Module):
    """Log-probabilities of the actions from measurements; ``network`` has its weights already.

    They are those at ``temperature``, so that whoever drives it draws from them as they are.
    """

    def __init__(self, config: RunConfig, network: Network, temperature: float = 1.0) -> None:
        super().__init__()
        self.temperature = temperature
        self.config = config
        self.network = network

    def forward(
        self,
        scan: Tensor,
        goal: Tensor,
        people: Tensor | None = None,
        count: Tensor | None = None,
    ) -> Tensor:
        """Float32 (N, actions) of scan (N, F * beams) in metres, goal (N, 6) or (N, 3), people
        (N, P, 4) in the robot frame (m, m/s) and int64 count (N,)."""
        maps = None
        if people is not None and count is not None:
            maps = draw_on_device(people, count, self.config.task)
        read = read_scan(scan, self.config.world.laser.range_max)
        logits = self.network(Inputs(read, self._clipped(goal), maps)).float()
        if self.temperature != 1.0:
            logits = logits / self.temperature
        return torch.log_softmax(logits, dim=1)

    def _clipped(self, goal: Tensor) -> Tensor:
        limit = self.config.task.variance_limit
        believed, variances = goal[:, :3], goal[:, 3:]
        # Written so that NaN also reads as the limit, as in ``goal_vector``.
        clipped = torch.where(variances < limit, variances, limit)
        return torch.cat((believed, clipped), dim=1)


def read_scan(metres: Tensor, range_max: float) -> Tensor:
    """What the networks read of ranges in metres, float32 in [0, 1]: ``quantise`` with tensors.

    Below 0 gives 0; above ``range_max``, infinity and NaN give 1.
    """
    counts = metres.double() * (SCAN_COUNTS / range_max)
    # NaN and infinity fail the test: both read as no echo.
    echo = counts < SCAN_COUNTS - 0.5
    counts = torch.where(echo, counts.clamp(min=0.0).round(), float(SCAN_COUNTS))
    return counts.float() * (1.0 / SCAN_COUNTS)
